//! Holding a mutex, and one small error for each operation of locks.

use super::core::Hold;
use super::mutex::Mutex;
use core::fmt;
use core::mem::ManuallyDrop;
use core::ops::{Deref, DerefMut};
use luna_core::current;
use thiserror::Error;

/// Whether this runs during the end of a process or branch that is cancelled, has failed or panics.
fn is_dying() -> bool {
    current::is_abandoned() || luna_platform::panics::is_panicking()
}

/// Holds a [`Mutex`], and leads to its value. Dropping it unlocks.
///
/// It may be kept across awaits, and be sent to another process or thread, which then unlocks; the
/// process that locked inherits until then. Dropped while a panic unwinds, or with the body of a
/// process (or a branch of a parallel construct) that was cancelled or has failed, it marks the
/// mutex: the next process to lock it learns of it by [`OwnerDied`]. A future that the process
/// itself drops (the loser of a race, say) unlocks as by scope: the process that dropped it lives,
/// and can be asked.
///
/// Real-time path: yes; O(1), and a system call if the next holder's thread sleeps, and if a
/// thread's OS priority is set back. Unlocking is no scheduling point: a more urgent process that
/// waited on the same executor runs at the next await.
///
/// ```
/// use luna_channels::lock_sync::Mutex;
///
/// let mutex = Mutex::new(vec![1]);
/// let mut guard = mutex.try_lock().unwrap();
/// guard.push(2);
/// guard.unlock(); // or at the end of its scope
/// assert_eq!(*mutex.try_lock().unwrap(), [1, 2]);
/// ```
#[must_use = "the mutex is unlocked when this is dropped"]
pub struct MutexGuard<'a, T> {
    mutex: &'a Mutex<T>,
    /// It was locked by something that was dying already: by a destructor, say. That is then no
    /// reason to mark the mutex.
    was_dying: bool,
}

// SAFETY: a shared guard gives out `&T` alone.
unsafe impl<T: Sync> Sync for MutexGuard<'_, T> {}

impl<'a, T> MutexGuard<'a, T> {
    /// Of the holder, which gives its hold away.
    #[inline]
    pub(super) fn new(mutex: &'a Mutex<T>, hold: Hold<'_>) -> Self {
        hold.used_for(mutex.core());
        Self {
            mutex,
            was_dying: is_dying(),
        }
    }

    /// Unlocks now. Never marks the mutex.
    pub fn unlock(self) {
        let guard = ManuallyDrop::new(self);
        guard.mutex.core().give_back(1);
    }

    /// The mutex that it holds.
    ///
    /// ```
    /// let mutex = luna_channels::lock_sync::Mutex::new(1);
    /// let guard = mutex.try_lock().unwrap();
    /// assert!(guard.mutex().try_lock().is_err());
    /// ```
    pub fn mutex(&self) -> &'a Mutex<T> {
        self.mutex
    }
}

impl<T> Drop for MutexGuard<'_, T> {
    #[inline]
    fn drop(&mut self) {
        if !self.was_dying && is_dying() {
            self.mutex.set_died(true);
        }
        self.mutex.core().give_back(1);
    }
}

impl<T> Deref for MutexGuard<'_, T> {
    type Target = T;
    #[inline]
    fn deref(&self) -> &T {
        // SAFETY: this guard exists, so no other thread accesses the value.
        self.mutex.value().with(|value| unsafe { &*value })
    }
}

impl<T> DerefMut for MutexGuard<'_, T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: this guard exists, so no other thread accesses the value; it is borrowed
        // exclusively, so this one does not either.
        self.mutex.value().with_mut(|value| unsafe { &mut *value })
    }
}

impl<T: fmt::Debug> fmt::Debug for MutexGuard<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

/// The mutex is locked, and its former holder has died while it held it: it panicked, was
/// cancelled, or its branch has failed. The guarded value may be half changed. (POSIX: a robust
/// mutex's `EOWNERDEAD`.)
///
/// It holds the mutex. [`recover`](Self::recover) clears the mark; [`into_guard`](Self::into_guard)
/// leaves it, so that the next process to lock learns of it too, and so does dropping this.
///
/// ```
/// use luna_channels::lock_sync::{LockError, Mutex};
///
/// let balance = Mutex::new(1);
/// let of_thread = balance.clone();
/// std::thread::spawn(move || {
///     let mut balance = of_thread.blocking_lock().unwrap();
///     *balance = -1;
///     panic!("in the middle of it");
/// })
/// .join()
/// .unwrap_err();
/// let Err(LockError::OwnerDied(died)) = balance.blocking_lock() else { panic!("it learns of it") };
/// let mut guard = died.recover();
/// *guard = 1;
/// drop(guard);
/// assert!(balance.blocking_lock().is_ok());
/// ```
#[derive(Error)]
#[error("{}", DIED)]
#[must_use = "it holds the mutex, which is unlocked, and still marked, when this is dropped"]
pub struct OwnerDied<'a, T>(MutexGuard<'a, T>);

impl<'a, T> OwnerDied<'a, T> {
    pub(super) fn new(guard: MutexGuard<'a, T>) -> Self {
        Self(guard)
    }

    /// The guard; the mutex is not marked any more. O(1).
    pub fn recover(self) -> MutexGuard<'a, T> {
        self.0.mutex.set_died(false);
        self.0
    }

    /// The guard, to look at what is there; the mutex stays marked. O(1).
    ///
    /// ```
    /// # use luna_channels::lock_sync::{Mutex, TryLockError};
    /// # let mutex = Mutex::new(3);
    /// # let of_thread = mutex.clone();
    /// # std::thread::spawn(move || { let _guard = of_thread.blocking_lock().unwrap(); panic!("dies") }).join().unwrap_err();
    /// for _ in 0..2 {
    ///     let Err(TryLockError::OwnerDied(died)) = mutex.try_lock() else { panic!("it is marked") };
    ///     assert_eq!(*died.into_guard(), 3);
    /// }
    /// ```
    pub fn into_guard(self) -> MutexGuard<'a, T> {
        self.0
    }
}

pub(super) const DIED: &str = "a process ended while it held the mutex, and the guarded value may be incomplete: recover the guard from the error";
const POISONED: &str =
    "a sibling of this branch of a parallel construct has failed, which poisons its operations";
const TIMEOUT: &str = "the time ran out";

/// Why [`lock`](super::Mutex::lock) or a [`wait`](super::Condvar::wait) did not simply lock.
#[derive(Error)]
pub enum LockError<'a, T> {
    /// The former holder died while it held the mutex. The error holds the mutex.
    #[error("{}", DIED)]
    OwnerDied(OwnerDied<'a, T>),
    /// A sibling of this branch of a parallel construct has failed, so that its operations fail as
    /// poisoned. It does not hold the mutex.
    #[error("{}", POISONED)]
    Poisoned,
}

/// Why [`try_lock`](super::Mutex::try_lock) did not simply lock.
#[derive(Error)]
pub enum TryLockError<'a, T> {
    /// The mutex is held.
    #[error("the mutex is locked")]
    Locked,
    /// The former holder died while it held the mutex. The error holds the mutex.
    #[error("{}", DIED)]
    OwnerDied(OwnerDied<'a, T>),
}

/// Why [`lock_timeout`](super::Mutex::lock_timeout) did not simply lock.
#[derive(Error)]
pub enum LockTimeoutError<'a, T> {
    /// The time ran out. It does not hold the mutex.
    #[error("{}", TIMEOUT)]
    Timeout,
    /// The former holder died while it held the mutex. The error holds the mutex.
    #[error("{}", DIED)]
    OwnerDied(OwnerDied<'a, T>),
    /// As [`LockError::Poisoned`].
    #[error("{}", POISONED)]
    Poisoned,
}

/// Why [`acquire`](super::Semaphore::acquire) failed: a sibling of this branch of a parallel
/// construct has failed, so that its operations fail as poisoned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("{}", POISONED)]
pub struct AcquireError;

/// Why [`acquire_timeout`](super::Semaphore::acquire_timeout) failed. It has no permits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum AcquireTimeoutError {
    /// The time ran out.
    #[error("{}", TIMEOUT)]
    Timeout,
    /// As [`AcquireError`].
    #[error("{}", POISONED)]
    Poisoned,
}

impl<'a, T> LockError<'a, T> {
    /// Whether the former holder died while it held the mutex.
    pub fn is_owner_died(&self) -> bool {
        matches!(self, LockError::OwnerDied(_))
    }

    /// The guard, if the mutex is held; it is not marked any more: see [`OwnerDied::recover`].
    pub fn recover(self) -> Option<MutexGuard<'a, T>> {
        match self {
            LockError::OwnerDied(died) => Some(died.recover()),
            LockError::Poisoned => None,
        }
    }
}

impl<T> TryLockError<'_, T> {
    /// Whether the mutex is held.
    pub fn is_locked(&self) -> bool {
        matches!(self, TryLockError::Locked)
    }
}

impl<T> LockTimeoutError<'_, T> {
    /// Whether the time ran out.
    pub fn is_timeout(&self) -> bool {
        matches!(self, LockTimeoutError::Timeout)
    }
}

impl AcquireTimeoutError {
    /// Whether the time ran out.
    pub fn is_timeout(self) -> bool {
        self == AcquireTimeoutError::Timeout
    }
}

impl<'a, T> From<LockError<'a, T>> for LockTimeoutError<'a, T> {
    fn from(error: LockError<'a, T>) -> Self {
        match error {
            LockError::OwnerDied(died) => LockTimeoutError::OwnerDied(died),
            LockError::Poisoned => LockTimeoutError::Poisoned,
        }
    }
}

impl From<AcquireError> for AcquireTimeoutError {
    fn from(AcquireError: AcquireError) -> Self {
        AcquireTimeoutError::Poisoned
    }
}

// Without the value, so that it need not be `Debug`.
luna_platform::debug_fields!(impl[T] LockError<'_, T>, |error| reason: format_args!("{error}"));
luna_platform::debug_fields!(impl[T] TryLockError<'_, T>, |error| reason: format_args!("{error}"));
luna_platform::debug_fields!(impl[T] LockTimeoutError<'_, T>, |error| reason: format_args!("{error}"));
luna_platform::debug_fields!(impl[T] OwnerDied<'_, T>, |error| reason: format_args!("{error}"));
