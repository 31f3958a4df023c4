//! A value that is set once, with the names of `std::sync::OnceLock`.

use core::cell::UnsafeCell;
use core::fmt;
use core::sync::atomic::{AtomicBool, Ordering};

/// A value that is set once, from any context.
pub struct OnceLock<T> {
    is_set: AtomicBool,
    value: UnsafeCell<Option<T>>,
}

// SAFETY: the value is written once, in a critical section, before it is marked as set, and then
// only read. One context may set it, and another drop it.
unsafe impl<T: Send + Sync> Sync for OnceLock<T> {}

impl<T> OnceLock<T> {
    /// Nothing is set.
    pub const fn new() -> Self {
        Self {
            is_set: AtomicBool::new(false),
            value: UnsafeCell::new(None),
        }
    }

    /// The value, if it is set.
    #[inline]
    pub fn get(&self) -> Option<&T> {
        if !self.is_set.load(Ordering::Acquire) {
            return None;
        }
        // SAFETY: it was written before it was marked as set, and is not written again.
        unsafe { &*self.value.get() }.as_ref()
    }

    /// Sets it.
    ///
    /// # Errors
    ///
    /// The value, if one is set already.
    pub fn set(&self, value: T) -> Result<(), T> {
        critical_section::with(|_| {
            if self.is_set.load(Ordering::Relaxed) {
                return Err(value);
            }
            // SAFETY: nothing reads it before it is marked as set, and nothing else writes it: this
            // is a critical section.
            unsafe { *self.value.get() = Some(value) };
            self.is_set.store(true, Ordering::Release);
            Ok(())
        })
    }
}

impl<T: fmt::Debug> fmt::Debug for OnceLock<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("OnceLock").field(&self.get()).finish()
    }
}
