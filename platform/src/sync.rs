//! All atomics come from here: the language's, or the checker's (loom's or shuttle's) when
//! a protocol is checked.

#[cfg(not(loom))]
pub use self::plain as atomic;
#[cfg(not(loom))]
pub use alloc::sync::Arc;

#[cfg(loom)]
pub use loom::sync::{Arc, atomic};

/// A value that is set once.
#[cfg(not(feature = "std"))]
pub use crate::bare::OnceLock;
#[cfg(feature = "std")]
pub use std::sync::OnceLock;

/// The atomics that no checker watches.
#[cfg(any(feature = "std", all(target_has_atomic = "64", not(debug_assertions))))]
pub use core::sync::atomic as plain;

/// The atomics; the 64-bit ones are critical sections. So are they in builds with debug assertions
/// on every processor, for the tests of a simulated one.
#[cfg(not(any(feature = "std", all(target_has_atomic = "64", not(debug_assertions)))))]
pub mod plain {
    pub use crate::bare::{AtomicI64, AtomicU64};
    pub use core::sync::atomic::*;
}

/// A cell with accesses that the model checker watches.
///
/// Outside loom's models it is `std::cell::UnsafeCell` with loom's closure interface, and compiles
/// to nothing.
#[cfg(any(not(loom), shuttle))]
#[derive(Debug)]
#[repr(transparent)]
pub struct UnsafeCell<T>(core::cell::UnsafeCell<T>);

#[cfg(any(not(loom), shuttle))]
impl<T> UnsafeCell<T> {
    /// A cell that holds `value`.
    #[inline]
    pub const fn new(value: T) -> Self {
        Self(core::cell::UnsafeCell::new(value))
    }

    /// Calls `f` with a pointer for reading.
    #[inline(always)]
    pub fn with<R>(&self, f: impl FnOnce(*const T) -> R) -> R {
        f(self.0.get())
    }

    /// Calls `f` with a pointer for writing.
    #[inline(always)]
    pub fn with_mut<R>(&self, f: impl FnOnce(*mut T) -> R) -> R {
        f(self.0.get())
    }
}

#[cfg(all(loom, not(shuttle)))]
pub use loom::cell::UnsafeCell;
