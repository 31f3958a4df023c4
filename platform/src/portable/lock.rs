//! A lock with the interface of the priority-inheriting one; it inherits nothing, since the
//! standard library offers no such lock.

use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

/// A mutual exclusion lock around a value.
///
/// On this backend it is `std::sync::Mutex` without poisoning: there are no real-time policies
/// here, so nothing to inherit.
#[derive(Debug)]
pub struct PiLock<T>(Mutex<T>);

/// Unlocks when dropped.
pub type PiGuard<'a, T> = MutexGuard<'a, T>;

impl<T> PiLock<T> {
    /// An unlocked lock around `value`.
    pub const fn new(value: T) -> Self {
        Self(Mutex::new(value))
    }

    /// Locks, waiting as long as another thread holds it.
    #[inline]
    pub fn lock(&self) -> PiGuard<'_, T> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Locks if the lock is free.
    pub fn try_lock(&self) -> Option<PiGuard<'_, T>> {
        match self.0.try_lock() {
            Ok(guard) => Some(guard),
            Err(TryLockError::Poisoned(error)) => Some(error.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }

    /// The value, without locking: the exclusive borrow shows that no guard exists.
    pub fn get_mut(&mut self) -> &mut T {
        self.0.get_mut().unwrap_or_else(PoisonError::into_inner)
    }
}
