//! One small error for each operation.

use super::guard::{MutexGuard, OwnerDied};
use std::error::Error;
use std::fmt;

const DIED: &str = "a process ended while it held the mutex, and the guarded value may be incomplete: recover the guard from the error";
const POISONED: &str =
    "a sibling of this branch of a parallel construct has failed, which poisons its operations";
const TIMEOUT: &str = "the time ran out";

/// Why [`lock`](super::Mutex::lock) or a [`wait`](super::Condvar::wait) did not simply lock.
pub enum LockError<'a, T> {
    /// The former holder died while it held the mutex. The error holds the mutex.
    OwnerDied(OwnerDied<'a, T>),
    /// A sibling of this branch of a parallel construct has failed, so that its operations fail as
    /// poisoned. It does not hold the mutex.
    Poisoned,
}

/// Why [`try_lock`](super::Mutex::try_lock) did not simply lock.
pub enum TryLockError<'a, T> {
    /// The mutex is held.
    Locked,
    /// The former holder died while it held the mutex. The error holds the mutex.
    OwnerDied(OwnerDied<'a, T>),
}

/// Why [`lock_timeout`](super::Mutex::lock_timeout) did not simply lock.
pub enum LockTimeoutError<'a, T> {
    /// The time ran out. It does not hold the mutex.
    Timeout,
    /// The former holder died while it held the mutex. The error holds the mutex.
    OwnerDied(OwnerDied<'a, T>),
    /// As [`LockError::Poisoned`].
    Poisoned,
}

/// Why [`acquire`](super::Semaphore::acquire) failed: a sibling of this branch of a parallel
/// construct has failed, so that its operations fail as poisoned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AcquireError;

/// Why [`acquire_timeout`](super::Semaphore::acquire_timeout) failed. It has no permits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AcquireTimeoutError {
    /// The time ran out.
    Timeout,
    /// As [`AcquireError`].
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

impl<T> fmt::Debug for LockError<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            LockError::OwnerDied(_) => "OwnerDied(..)",
            LockError::Poisoned => "Poisoned",
        })
    }
}

impl<T> fmt::Debug for TryLockError<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            TryLockError::Locked => "Locked",
            TryLockError::OwnerDied(_) => "OwnerDied(..)",
        })
    }
}

impl<T> fmt::Debug for LockTimeoutError<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            LockTimeoutError::Timeout => "Timeout",
            LockTimeoutError::OwnerDied(_) => "OwnerDied(..)",
            LockTimeoutError::Poisoned => "Poisoned",
        })
    }
}

impl<T> fmt::Display for OwnerDied<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(DIED)
    }
}

impl<T> fmt::Display for LockError<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            LockError::OwnerDied(_) => DIED,
            LockError::Poisoned => POISONED,
        })
    }
}

impl<T> fmt::Display for TryLockError<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            TryLockError::Locked => "the mutex is locked",
            TryLockError::OwnerDied(_) => DIED,
        })
    }
}

impl<T> fmt::Display for LockTimeoutError<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            LockTimeoutError::Timeout => TIMEOUT,
            LockTimeoutError::OwnerDied(_) => DIED,
            LockTimeoutError::Poisoned => POISONED,
        })
    }
}

impl fmt::Display for AcquireError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(POISONED)
    }
}

impl fmt::Display for AcquireTimeoutError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            AcquireTimeoutError::Timeout => TIMEOUT,
            AcquireTimeoutError::Poisoned => POISONED,
        })
    }
}

impl<T> Error for OwnerDied<'_, T> {}
impl<T> Error for LockError<'_, T> {}
impl<T> Error for TryLockError<'_, T> {}
impl<T> Error for LockTimeoutError<'_, T> {}
impl Error for AcquireError {}
impl Error for AcquireTimeoutError {}
