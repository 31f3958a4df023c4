//! The standard library cannot lock memory.

use crate::shortfall::MemoryRefusal;

pub(crate) fn lock() -> Result<(), MemoryRefusal> {
    Err(MemoryRefusal::Unsupported)
}

/// Nothing was copied.
pub(crate) fn copy(_: usize, _: &mut [u8]) -> usize {
    0
}

/// Nothing was locked.
pub(crate) fn unlock() {}

/// The allocator's settings are not the standard library's.
pub(crate) fn keep_heap() {}
