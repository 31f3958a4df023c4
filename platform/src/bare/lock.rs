//! A lock with the interface of the priority-inheriting one: the critical section.

use super::critical;
use core::cell::{Cell, UnsafeCell};
use core::fmt;
use core::marker::PhantomData;
use core::ops::{Deref, DerefMut};

/// A mutual exclusion lock around a value.
///
/// On this backend it is the critical section: no interrupt comes while one is held, so nothing
/// waits for it and nothing is to be inherited. Several may be held, and are left in any order.
///
/// With sections of the crate `critical-section` they nest: a guard that is held when such a section
/// begins is dropped after its end, and one that is made in a section is dropped in it. Otherwise
/// the section ends too early. The caller of [`install`](crate::bare::install) promises that.
pub struct PiLock<T> {
    is_held: Cell<bool>,
    value: UnsafeCell<T>,
}

// SAFETY: both fields are used in the critical section alone, by one context at a time. The value
// goes from one to another only if it may.
unsafe impl<T: Send> Sync for PiLock<T> {}

/// Unlocks when dropped.
pub struct PiGuard<'a, T> {
    lock: &'a PiLock<T>,
    stays_in_its_context: PhantomData<*const ()>,
}

// SAFETY: a shared guard gives shared references to the value alone.
unsafe impl<T: Sync> Sync for PiGuard<'_, T> {}

impl<T> PiLock<T> {
    /// An unlocked lock around `value`.
    pub const fn new(value: T) -> Self {
        Self {
            is_held: Cell::new(false),
            value: UnsafeCell::new(value),
        }
    }

    /// Locks.
    ///
    /// # Panics
    ///
    /// If this context holds it already.
    #[inline]
    #[track_caller]
    pub fn lock(&self) -> PiGuard<'_, T> {
        match self.try_lock() {
            Some(guard) => guard,
            None => panic!("this context holds the lock already"),
        }
    }

    /// Locks if the lock is free.
    #[inline]
    pub fn try_lock(&self) -> Option<PiGuard<'_, T>> {
        critical::enter();
        if self.is_held.replace(true) {
            // SAFETY: this has entered just now.
            unsafe { critical::leave() };
            return None;
        }
        Some(PiGuard {
            lock: self,
            stays_in_its_context: PhantomData,
        })
    }

    /// The value, without locking: the exclusive borrow shows that no guard exists.
    pub fn get_mut(&mut self) -> &mut T {
        self.value.get_mut()
    }
}

impl<T> Drop for PiGuard<'_, T> {
    #[inline]
    fn drop(&mut self) {
        self.lock.is_held.set(false);
        // SAFETY: `try_lock` has entered for this guard.
        unsafe { critical::leave() };
    }
}

impl<T> Deref for PiGuard<'_, T> {
    type Target = T;
    #[inline]
    fn deref(&self) -> &T {
        // SAFETY: the guard is the only one of the lock, and its context runs.
        unsafe { &*self.lock.value.get() }
    }
}

impl<T> DerefMut for PiGuard<'_, T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: as in `deref`, and the guard is borrowed exclusively.
        unsafe { &mut *self.lock.value.get() }
    }
}

impl<T: fmt::Debug> fmt::Debug for PiLock<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.try_lock() {
            Some(guard) => f.debug_tuple("PiLock").field(&*guard).finish(),
            None => f.write_str("PiLock(held)"),
        }
    }
}

impl<T: fmt::Debug> fmt::Debug for PiGuard<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}
