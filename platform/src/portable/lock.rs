//! A lock with the interface of the priority-inheriting one; it inherits nothing, since the
//! standard library offers no such lock.

use std::fmt;
use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A mutual exclusion lock around a value.
///
/// On this backend it is `std::sync::Mutex` without poisoning: there are no real-time policies
/// here, so nothing to inherit.
pub struct PiLock<T>(Mutex<T>);

/// Unlocks when dropped.
pub struct PiGuard<'a, T>(MutexGuard<'a, T>);

impl<T> PiLock<T> {
    /// An unlocked lock around `value`.
    pub const fn new(value: T) -> Self {
        Self(Mutex::new(value))
    }

    /// Locks, waiting as long as another thread holds it.
    #[inline]
    pub fn lock(&self) -> PiGuard<'_, T> {
        PiGuard(self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Locks if the lock is free.
    pub fn try_lock(&self) -> Option<PiGuard<'_, T>> {
        match self.0.try_lock() {
            Ok(guard) => Some(PiGuard(guard)),
            Err(std::sync::TryLockError::Poisoned(error)) => Some(PiGuard(error.into_inner())),
            Err(std::sync::TryLockError::WouldBlock) => None,
        }
    }

    /// The value, without locking: the exclusive borrow shows that no guard exists.
    pub fn get_mut(&mut self) -> &mut T {
        self.0.get_mut().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T> Deref for PiGuard<'_, T> {
    type Target = T;
    #[inline]
    fn deref(&self) -> &T {
        &self.0
    }
}

impl<T> DerefMut for PiGuard<'_, T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut T {
        &mut self.0
    }
}

impl<T: fmt::Debug> fmt::Debug for PiLock<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("PiLock").field(&self.0).finish()
    }
}

impl<T: fmt::Debug> fmt::Debug for PiGuard<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}
