//! The interface without the feature `events`: it does nothing.

use super::Kind;
use alloc::string::String;
use core::task::Poll;

/// Whether the calling thread is recorded: never.
#[inline(always)]
pub const fn is_on() -> bool {
    false
}

/// Does nothing.
#[inline(always)]
pub fn report(_: u16, _: u32, _: impl FnOnce() -> [u64; 2]) {}

/// Does nothing.
#[inline(always)]
pub fn waits_for(_: impl FnOnce() -> (Kind, u32)) {}

/// Does nothing.
#[inline(always)]
pub fn waits_for_other() {}

/// Does nothing.
#[inline(always)]
pub fn waits_for_several() {}

/// Does nothing.
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

/// Does nothing.
#[inline(always)]
pub fn ready(_: impl FnOnce() -> u32) {}

/// Does nothing.
#[inline(always)]
pub fn begin_turn(_: u32) {}

/// Does nothing.
#[inline(always)]
pub fn end_turn(_: u32, _: bool) {}

/// Does nothing.
#[inline(always)]
pub fn note_failure() {}

/// Does nothing.
#[inline(always)]
pub fn done(_: u32, _: u64) {}

/// No process number is needed.
#[inline(always)]
pub fn current_process() -> u64 {
    0
}

/// Does nothing.
#[inline(always)]
pub fn name(_: Kind, _: u32, _: u32, _: impl FnOnce() -> String) {}

/// Does nothing.
#[inline(always)]
pub fn name_in_ring(_: Kind, _: u32, _: &str) {}

/// Runs the turn of a sub-process, without events.
#[inline(always)]
pub fn sub_turn<T>(_: u32, _: [u64; 2], poll: impl FnOnce() -> Poll<T>) -> Poll<T> {
    poll()
}

/// Does nothing.
#[inline(always)]
pub fn name_process(_: u32, _: u8, _: impl FnOnce() -> String) {}

/// Does nothing.
#[inline(always)]
pub fn name_executor(_: impl FnOnce() -> String) {}

/// Does nothing.
#[inline(always)]
pub fn report_executor(_: u16) {}

/// The ring of an executor that shares its thread with others: none.
#[derive(Debug, Default)]
pub struct Kept(());

impl Kept {
    /// Does nothing.
    #[inline(always)]
    pub fn exchange(&mut self) {}
}
