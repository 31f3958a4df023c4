//! A thread without the feature `events`: it is never traced.

use super::Kind;
use alloc::string::String;

/// Whether the calling thread is traced: never.
#[inline(always)]
pub const fn is_on() -> bool {
    false
}

#[inline(always)]
pub(super) fn put(_: u16, _: u32, _: [u64; 2]) {}

#[inline(always)]
pub(super) fn place() -> Option<(u64, u32)> {
    None
}

/// The future itself.
#[inline(always)]
pub fn waits_in<F>(_: (Kind, u32), future: F) -> F {
    future
}

/// Does nothing.
#[inline(always)]
pub fn name(_: Kind, _: u32, _: u32, _: impl FnOnce() -> String) {}

/// Does nothing.
#[inline(always)]
pub fn name_process(_: u32, _: u8, _: impl FnOnce() -> String) {}

/// Does nothing.
#[inline(always)]
pub fn name_executor(_: impl FnOnce() -> String) {}

/// The ring of an executor that shares its thread with others: none.
#[derive(Debug, Default)]
pub struct Kept(());

impl Kept {
    /// Does nothing.
    #[inline(always)]
    pub fn exchange(&mut self) {}
}
