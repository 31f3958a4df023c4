//! Plain locks, which cannot be detected at run time while they are free: this lists where the
//! libraries have any, and why each is off the real-time path.

use std::fs;
use std::path::{Path, PathBuf};

/// The libraries' sources. The modelled and the portable platform make no real-time claim.
const SOURCES: [&str; 10] = [
    "platform/src",
    "core/src",
    "channels/src",
    "machine/src",
    "runtime/replay/src",
    "runtime/config/src",
    "runtime/error/src",
    "devices/external/src",
    "devices/manager/src",
    "src",
];
const WITHOUT_CLAIM: [&str; 3] = [
    "platform/src/model",
    "platform/src/portable",
    "machine/src/portable",
];

/// Files in which these words mean the framework's own locks.
const OWN: [&str; 5] = [
    "channels/src/lock_sync",
    "src/csp/composition.rs",
    "src/sync.rs",
    "src/sync/watch.rs",
    "src/system/compose.rs",
];

/// What blocks without priority inheritance, as it is imported or named.
const PLAIN: [&str; 5] = ["Mutex", "RwLock", "Condvar", "mpsc", "parking_lot"];

/// The files with a plain lock, and why it is off the path.
const KNOWN: [(&str, &str); 16] = [
    (
        "channels/src/inspect.rs",
        "places enlist when they are made and freed, and reports look",
    ),
    (
        "channels/src/inspect/register.rs",
        "places enlist when they are made and freed, and reports look",
    ),
    (
        "core/src/simulation/calls.rs",
        "on a virtual clock nothing is real time",
    ),
    (
        "core/src/simulation/drive.rs",
        "on a virtual clock nothing is real time",
    ),
    (
        "devices/manager/src/manager.rs",
        "devices are opened at set-up, and closed where the path is left",
    ),
    (
        "machine/src/crash.rs",
        "watches are installed before the start and removed after the end; the handler takes no lock",
    ),
    (
        "machine/src/memory.rs",
        "memory is locked before the start and unlocked after the end",
    ),
    (
        "machine/src/signals.rs",
        "watches are installed before the start and removed after the end",
    ),
    (
        "platform/src/thread/mod.rs",
        "a thread reports its start, once",
    ),
    (
        "runtime/config/src/deployment/mod.rs",
        "the file is matched while the system is set up; a loop's period has no lock",
    ),
    (
        "runtime/config/src/parameters/store/mod.rs",
        "parameters are declared before the body, and set and listed off the path; a loop uses another lock",
    ),
    (
        "runtime/config/src/parameters/watch.rs",
        "the end of the thread that looks at the parameters' file",
    ),
    (
        "runtime/replay/src/recorder.rs",
        "a process is entered when it is spawned, and the writer takes over what is new",
    ),
    (
        "runtime/replay/src/replayer/mod.rs",
        "a replay is on a virtual clock, where nothing is real time",
    ),
    (
        "src/safety/guardian.rs",
        "the guardian is started before the start and notified after the end",
    ),
    (
        "src/system/plan/mod.rs",
        "a system's plan belongs to its builder; while it runs, spawning, supervision and reports read it, off the path",
    ),
];
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// All files below `folder` that are no tests, relative to the root.
fn files(folder: &str, found: &mut Vec<String>) {
    for entry in fs::read_dir(root().join(folder)).unwrap() {
        let entry = entry.unwrap();
        let name = entry.file_name().into_string().unwrap();
        let path = format!("{folder}/{name}");
        if entry.file_type().unwrap().is_dir() {
            let is_exempt = [&WITHOUT_CLAIM[..], &OWN].concat().contains(&&*path);
            if !name.contains("tests") && !is_exempt {
                files(&path, found);
            }
        } else if name.ends_with(".rs") && !name.contains("tests") && !OWN.contains(&&*path) {
            found.push(path);
        }
    }
}

/// Whether a line of code, which is no comment, names a plain lock.
fn names_one(line: &str) -> bool {
    let code = line.split("//").next().unwrap_or_default();
    let mut words = code.split(|c: char| !c.is_alphanumeric() && c != '_');
    words.any(|word| PLAIN.contains(&word))
}

/// Whether a file has one outside of its tests.
fn has_one(text: &str) -> bool {
    let is_test = |line: &&str| line.trim_start().starts_with("#[cfg(") && line.contains("test");
    text.lines()
        .take_while(|line| !is_test(line))
        .any(names_one)
}

#[test]
fn plain_locks_are_where_they_are_known_to_be_off_the_path() {
    let mut all = Vec::new();
    SOURCES.iter().for_each(|folder| files(folder, &mut all));
    assert!(
        all.len() > 50,
        "the sources are not where they were: {all:?}"
    );
    let mut with_one = Vec::new();
    for file in all {
        if has_one(&fs::read_to_string(root().join(&file)).unwrap()) {
            with_one.push(file);
        }
    }
    with_one.sort();
    let known: Vec<&str> = KNOWN.iter().map(|(file, _)| *file).collect();
    assert_eq!(
        with_one, known,
        "left: files with a plain lock; right: those that are known. Use the platform's PiLock where the path goes; where it does not, \
         add the file to the list, with the reason"
    );
}

#[test]
fn a_plain_lock_is_found() {
    assert!(has_one("use std::sync::{Arc, Mutex};"));
    assert!(has_one("fn f() {}\nlet lock = std::sync::RwLock::new(());"));
    assert!(!has_one(
        "// A Mutex is not for the path.\nuse luna_platform::lock::PiLock;"
    ));
    assert!(!has_one(
        "#[cfg(all(test, not(loom)))]\nmod tests { use std::sync::Mutex; }"
    ));
}
