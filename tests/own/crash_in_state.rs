//! A thread crashes while it copies the safety state. The emergency functions run all the same, and
//! may report something themselves, since no memory is allocated under the state's lock.

#![cfg(unix)]

use crate::common;
use common::{Program, SpawnOk, with_signals};
use luna::Error;
use luna::prelude::*;
use nix::sys::signal::Signal;
use std::alloc::Layout;
use std::os::unix::process::ExitStatusExt;
use std::sync::atomic::{AtomicBool, Ordering};

/// Nothing else is of this size.
const TELLING: usize = 40_099;

static IS_ARMED: AtomicBool = AtomicBool::new(false);

/// Aborts as an allocator does that finds itself overwritten.
pub(crate) fn abort_if_armed(layout: Layout) {
    if layout.size() == TELLING && IS_ARMED.load(Ordering::SeqCst) {
        std::process::abort();
    }
}

/// What the child program runs; nothing when this program runs it as a test.
#[test]
fn part() {
    if common::part().is_none() {
        return;
    }
    // No dump of this program's memory is wanted.
    nix::sys::resource::setrlimit(nix::sys::resource::Resource::RLIMIT_CORE, 0, 0).unwrap();
    let mut system = System::new("crashing");
    let safety = system.safety();
    system.on_emergency("first", move || {
        // It would wait for the crashed thread, which would hold the lock for good.
        safety.warn(Error::Timeout);
        println!("function, {}", safety.degree());
    });
    system.thread("own").process("culprit").spawn_ok(async {
        let safety = luna::safety::current().unwrap();
        let cause = Error::Panicked("x".repeat(TELLING));
        IS_ARMED.store(true, Ordering::SeqCst);
        // Moved, and not copied, on the path.
        safety.warn(cause);
        println!("warned");
        drop(safety.state());
        println!("not reached");
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn one_that_looks_holds_no_lock_meanwhile() {
    own_process!();
    let Some(_watch) = with_signals() else { return };
    let ended = Program::start("state").end();
    let lines = ["warned", "function, emergency", "not reached"];
    assert_eq!(ended.said(&lines), lines[..2], "{ended:?}");
    assert_eq!(ended.status.signal(), Some(Signal::SIGABRT as i32));
}
