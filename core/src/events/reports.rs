//! What processes and executors report.

use super::trace::{is_on, place, put};
use super::{code, waits};
use crate::current::{self, User};

/// Reports an event of the calling thread, if the thread is traced. Real-time path: yes;
/// wait-free, O(1).
#[inline(always)]
pub fn report(of: u16, subject: u32, arguments: impl FnOnce() -> [u64; 2]) {
    if is_on() {
        report_now(of, subject, arguments());
    }
}

#[cold]
#[inline(never)]
fn report_now(of: u16, subject: u32, arguments: [u64; 2]) {
    put(of, subject, arguments);
}

/// Reports that a process of the calling thread has become ready, and the current process as the
/// one that readied it.
#[inline(always)]
pub fn ready(process: impl FnOnce() -> u32) {
    if is_on() {
        report_ready(process());
    }
}

#[cold]
#[inline(never)]
fn report_ready(process: u32) {
    put(code::READY, process, [current_process(), 0]);
}

/// Reports that the turn of a process begins.
#[inline]
pub fn begin_turn(process: u32) {
    if is_on() {
        waits::clear();
        put(code::RUNNING, process, [0, 0]);
    }
}

/// Reports that the turn of a process ends and the process goes on; `is_ready`: it is ready again
/// already, else it waits.
#[inline]
pub fn end_turn(process: u32, is_ready: bool) {
    if is_on() {
        let arguments = match is_ready {
            true => [code::STILL_READY, 0],
            false => waits::arguments(),
        };
        put(code::WAITING, process, arguments);
    }
}

/// Notes that the body of the current process has returned an error: for [`done`].
#[inline]
pub fn note_failure() {
    if is_on() {
        waits::fail();
    }
}

/// Reports that a process has ended; `how` is one of [`code::ended`]. A noted error takes
/// precedence.
#[inline]
pub fn done(process: u32, how: u64) {
    if is_on() {
        let has_failed = how == code::ended::OK && waits::has_failed();
        put(
            code::DONE,
            process,
            [if has_failed { code::ended::ERROR } else { how }, 0],
        );
    }
}

/// The number of the current process; 0 if there is none.
pub fn current_process() -> u64 {
    match current::user() {
        User::Process(id) => id.get().into(),
        User::Outside => 0,
    }
}

/// Reports that the executor of the calling thread sleeps, or is awake.
#[inline]
pub fn report_executor(of: u16) {
    if let Some((_, number)) = place() {
        put(of, number, [0, 0]);
    }
}
