//! The allocator of a guarded program.

use crate::Kind;
#[cfg(luna_path_guard)]
use crate::watch::noting;
use std::alloc::{GlobalAlloc, Layout, System};

/// Passes all calls on to another allocator, and checks those made on the path. A guarded program
/// makes it its global allocator; without `--cfg luna_path_guard` it only passes calls on.
///
/// ```
/// use luna_path_guard::Allocator;
///
/// #[global_allocator]
/// static ALLOCATOR: Allocator = Allocator::new();
/// ```
#[derive(Debug, Default)]
pub struct Allocator<A = System>(A);

impl Allocator {
    /// Around the system's allocator.
    pub const fn new() -> Self {
        Self(System)
    }
}

impl<A> Allocator<A> {
    /// Around `allocator`.
    ///
    /// ```
    /// use luna_path_guard::Allocator;
    /// use std::alloc::System;
    ///
    /// static ALLOCATOR: Allocator<System> = Allocator::around(System);
    /// # let _ = &ALLOCATOR;
    /// ```
    pub const fn around(allocator: A) -> Self {
        Self(allocator)
    }
}

/// Nothing is noted in a build without the guard.
#[cfg(not(luna_path_guard))]
#[inline(always)]
fn noting<R>(_: Kind, f: impl FnOnce() -> R) -> R {
    f()
}

// SAFETY: each call is passed on unchanged to the inner allocator, which keeps the contract, and
// its result is returned unchanged.
unsafe impl<A: GlobalAlloc> GlobalAlloc for Allocator<A> {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let bytes = layout.size();
        // SAFETY: the caller promises a layout that is not of size 0, which is passed on.
        noting(Kind::Allocation { bytes }, || unsafe {
            self.0.alloc(layout)
        })
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        let bytes = layout.size();
        // SAFETY: the caller promises a layout that is not of size 0, which is passed on.
        noting(Kind::Allocation { bytes }, || unsafe {
            self.0.alloc_zeroed(layout)
        })
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        let bytes = layout.size();
        // SAFETY: the caller promises that this allocator made the block, with this layout. So the
        // inner one made it, with that layout, since all calls are passed on unchanged.
        noting(Kind::Free { bytes }, || unsafe {
            self.0.dealloc(pointer, layout)
        })
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        let (from, to) = (layout.size(), size);
        // SAFETY: the caller promises that this allocator made the block, with this layout, and
        // that the new size is one of a layout, and not 0. So the inner one made the block, with
        // that layout.
        noting(Kind::Reallocation { from, to }, || unsafe {
            self.0.realloc(pointer, layout, size)
        })
    }
}
