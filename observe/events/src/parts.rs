//! Named parts of processes.

use crate::code;
use luna_core::events::{Kind, current_process, is_on, of_part, report};
use std::task::Poll;

/// Not an event, but the begin of a name that is made on the real-time path: its length in bytes
/// with its [`Kind`] in the upper half, and its process. Parts of 16 bytes each follow.
pub const TEXT_HEAD: u16 = 0xFF00;
/// Not an event, but a part of a name.
pub const TEXT: u16 = 0xFF01;

/// Runs the turn of a sub-process, and reports it: `of` are its process, and the sub-process around
/// it or 0. What the sub-process waits for is reported for it alone, and counts as what its process
/// waits for, too.
pub fn sub_turn<T>(number: u32, of: [u64; 2], poll: impl FnOnce() -> Poll<T>) -> Poll<T> {
    if !is_on() {
        return poll();
    }
    report(code::SUB_RUNNING, number, || of);
    let (polled, waits) = of_part(poll);
    if polled.is_pending() {
        report(code::SUB_WAITING, number, || waits);
    }
    polled
}

/// Names a part of the current process, on the real-time path: in the ring. Wait-free, O(bytes).
pub fn name_in_ring(kind: Kind, number: u32, name: &str) {
    if !is_on() {
        return;
    }
    let head = (kind as u64) << 32 | name.len() as u64;
    report(TEXT_HEAD, number, || [head, current_process()]);
    for part in name.as_bytes().chunks(16) {
        let mut words = [0; 16];
        words[..part.len()].copy_from_slice(part);
        let (first, second) = words.split_at(8);
        let word = |bytes: &[u8]| u64::from_le_bytes(bytes.try_into().unwrap_or_default());
        report(TEXT, number, || [word(first), word(second)]);
    }
}
