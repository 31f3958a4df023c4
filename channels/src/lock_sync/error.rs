//! One small error for each operation.

use super::guard::{MutexGuard, OwnerDied};
use thiserror::Error;

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
