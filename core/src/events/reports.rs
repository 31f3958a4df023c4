//! What processes and executors report, and what that is made of.

use super::thread::{is_on, place, put};
use super::{Kind, code, waits};
use crate::current::{self, User};
use core::task::Poll;

/// Not an event, but the begin of a name that is made on the real-time path: its length in bytes
/// with its [`Kind`] in the upper half, and its process. Parts of 16 bytes each follow.
pub const TEXT_HEAD: u16 = 0xFF00;
/// Not an event, but a part of a name.
pub const TEXT: u16 = 0xFF01;

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

/// Runs the turn of a sub-process, and reports it: `of` are its process, and the sub-process around
/// it or 0. What the sub-process waits for is reported for it alone, and counts as what its process
/// waits for, too.
pub fn sub_turn<T>(number: u32, of: [u64; 2], poll: impl FnOnce() -> Poll<T>) -> Poll<T> {
    if !is_on() {
        return poll();
    }
    put(code::SUB_RUNNING, number, of);
    let (polled, waits) = waits::of_part(poll);
    if polled.is_pending() {
        put(code::SUB_WAITING, number, waits);
    }
    polled
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

/// Names a part of the current process, on the real-time path: in the ring. Wait-free, O(bytes).
pub fn name_in_ring(kind: Kind, number: u32, name: &str) {
    if !is_on() {
        return;
    }
    let head = (kind as u64) << 32 | name.len() as u64;
    put(TEXT_HEAD, number, [head, current_process()]);
    for part in name.as_bytes().chunks(16) {
        let mut words = [0; 16];
        words[..part.len()].copy_from_slice(part);
        let (first, second) = words.split_at(8);
        let word = |bytes: &[u8]| u64::from_le_bytes(bytes.try_into().unwrap_or_default());
        put(TEXT, number, [word(first), word(second)]);
    }
}
