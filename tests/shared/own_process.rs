//! Runs a test in a child process, while no other test of this program runs.

use std::process::Command;
use std::sync::{Mutex, PoisonError};

/// Set in the child.
const IS_OWN: &str = "LUNA_TEST_OWN_PROCESS";

/// To stand first in a test: in the parent it runs the test in a child process and returns from it.
/// In the child it makes a watchdog, but for a `long` test. This module's parent is `shared` in the
/// program's root.
#[allow(unused_macros, reason = "each test program uses some of it")]
macro_rules! own_process {
    () => {
        own_process!(long);
        let _watchdog = $crate::shared::watchdog();
    };
    (long) => {
        fn here() {}
        if $crate::shared::own_process::ran_in_child(std::any::type_name_of_val(&here)) {
            return;
        }
    };
}

/// Whether the test ran in a child, and passed there; false in the child. `here` is the path of a
/// function inside the test.
pub(crate) fn ran_in_child(here: &str) -> bool {
    if std::env::var_os(IS_OWN).is_some() {
        return false;
    }
    // One child at a time: real-time tests would disturb each other.
    static ALONE: Mutex<()> = Mutex::new(());
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    // `own::module::test::here` names `module::test`.
    let (_crate, path) = here.split_once("::").unwrap();
    let test = path.strip_suffix("::here").unwrap();
    let child = Command::new(std::env::current_exe().unwrap())
        .args([test, "--exact", "--nocapture"])
        .env(IS_OWN, "1")
        // With one test thread the test would run on the main thread, which the allocation counts
        // leave out.
        .env("RUST_TEST_THREADS", "2")
        .output()
        .unwrap();
    let output = String::from_utf8_lossy(&child.stdout);
    let errors = String::from_utf8_lossy(&child.stderr);
    assert!(
        child.status.success() && output.contains("1 passed"),
        "{test} in a process of its own: {}\n{output}\n{errors}",
        child.status
    );
    for line in errors.lines().filter(|line| line.starts_with("skipped:")) {
        report!("{line}");
    }
    true
}
