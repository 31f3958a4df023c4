//! The fences of biased locks: the contexts of one CPU see its stores in their order, so only the
//! compiler is kept from changing it.

use core::sync::atomic::{Ordering, compiler_fence};

/// Asks for the heavy fence, once for the program.
pub fn prepare() {}

/// Whether the heavy fence can be had.
#[inline(always)]
pub fn is_available() -> bool {
    true
}

/// Orders what this context does for one that calls [`heavy`].
#[inline(always)]
pub fn light() {
    compiler_fence(Ordering::SeqCst);
}

/// A full fence for all contexts.
#[inline]
pub fn heavy() {
    compiler_fence(Ordering::SeqCst);
}
