//! Without events: the same names, and nothing behind them.

use super::Kind;
use std::task::Poll;

/// Whether the calling thread is recorded: never.
#[inline(always)]
pub const fn is_on() -> bool {
    false
}

/// Tells an event: nobody.
#[inline(always)]
pub fn tell(_: u16, _: u32, _: impl FnOnce() -> [u64; 2]) {}

/// Notes what the current process waits for: nowhere.
#[inline(always)]
pub fn waits_for(_: impl FnOnce() -> (Kind, u32)) {}

/// Notes that the current process waits for something without a number: nowhere.
#[inline(always)]
pub fn waits_for_other() {}

/// Notes that the current process waits for several things: nowhere.
#[inline(always)]
pub fn waits_for_several() {}

/// Takes a note back: there is none.
#[inline(always)]
pub fn waits_no_more(_: impl FnOnce() -> Option<(Kind, u32)>) {}

/// Calls `f`.
#[inline(always)]
pub fn beside<R>(f: impl FnOnce() -> R) -> R {
    f()
}

/// The future itself.
#[inline(always)]
pub fn waits_in<F>(_: (Kind, u32), future: F) -> F {
    future
}

/// Tells that a process has become ready: nobody.
#[inline(always)]
pub fn ready(_: impl FnOnce() -> u32) {}

/// Tells that a turn begins: nobody.
#[inline(always)]
pub fn begin_turn(_: u32) {}

/// Tells that a turn ends: nobody.
#[inline(always)]
pub fn end_turn(_: u32, _: bool) {}

/// Notes that a body has failed: nowhere.
#[inline(always)]
pub fn note_failure() {}

/// Tells that a process has ended: nobody.
#[inline(always)]
pub fn done(_: u32, _: u64) {}

/// The number of the current process: nobody asks.
#[inline(always)]
pub fn current_process() -> u64 {
    0
}

/// Names something: to nobody.
#[inline(always)]
pub fn name(_: Kind, _: u32, _: u32, _: impl FnOnce() -> String) {}

/// Names something of the current process: to nobody.
#[inline(always)]
pub fn name_in_ring(_: Kind, _: u32, _: &str) {}

/// Runs the turn of a sub-process: tells nobody.
#[inline(always)]
pub fn sub_turn<T>(_: u32, _: [u64; 2], poll: impl FnOnce() -> Poll<T>) -> Poll<T> {
    poll()
}

/// Names a process: to nobody.
#[inline(always)]
pub fn name_process(_: u32, _: u8, _: impl FnOnce() -> String) {}

/// Names the executor that the calling thread is: to nobody.
#[inline(always)]
pub fn name_executor(_: impl FnOnce() -> String) {}

/// Tells of the executor that the calling thread is: nobody.
#[inline(always)]
pub fn tell_executor(_: u16) {}

/// The ring of a home that shares its thread with others: none.
#[derive(Debug, Default)]
pub struct Kept(());

impl Kept {
    /// Does nothing.
    #[inline(always)]
    pub fn exchange(&mut self) {}
}
