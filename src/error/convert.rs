//! What turns into an [`Error`] with `?`.

use super::{Error, SetupError};
use luna_channels as channels;
use luna_channels::lock_sync::{
    AcquireError, AcquireTimeoutError, LockError, LockTimeoutError, TryLockError,
};
use luna_executors::Nested;
use luna_platform::memory::HeapError;
use luna_platform::signals::SignalError;
use luna_platform::thread::{AttributeError, SpawnError};
use std::convert::Infallible;

impl From<AttributeError> for Error {
    fn from(error: AttributeError) -> Error {
        Error::Setup(SetupError::Attributes(error))
    }
}

impl From<Nested> for Error {
    fn from(Nested: Nested) -> Error {
        Error::Setup(SetupError::Nested)
    }
}

impl From<HeapError> for Error {
    fn from(error: HeapError) -> Error {
        Error::Setup(SetupError::System {
            message: error.to_string(),
        })
    }
}

impl From<SignalError> for Error {
    fn from(error: SignalError) -> Error {
        Error::Setup(SetupError::System {
            message: error.to_string(),
        })
    }
}

impl Error {
    /// A thread of `of` that did not start.
    pub(crate) fn not_started(of: &str, error: SpawnError<Infallible>) -> Error {
        Error::Setup(match error {
            SpawnError::Attributes(error) => SetupError::Attributes(error),
            SpawnError::Refused(shortfall) => SetupError::Refused {
                of: of.to_owned(),
                shortfall,
            },
            other => SetupError::Thread {
                message: other.to_string(),
            },
        })
    }
}

impl<T> From<channels::SendError<T>> for Error {
    fn from(error: channels::SendError<T>) -> Error {
        if error.poisoned {
            Error::Poisoned
        } else {
            Error::Closed
        }
    }
}

impl From<channels::RecvError> for Error {
    fn from(error: channels::RecvError) -> Error {
        match error {
            channels::RecvError::Poisoned => Error::Poisoned,
            channels::RecvError::Closed => Error::Closed,
        }
    }
}

impl<T> From<channels::TrySendError<T>> for Error {
    fn from(error: channels::TrySendError<T>) -> Error {
        match error {
            channels::TrySendError::Full(_) => Error::Full,
            channels::TrySendError::Closed(_) => Error::Closed,
            channels::TrySendError::Poisoned(_) => Error::Poisoned,
        }
    }
}

impl<Q> From<channels::CallError<Q>> for Error {
    fn from(error: channels::CallError<Q>) -> Error {
        match error {
            channels::CallError::Closed(_) => Error::Closed,
            channels::CallError::Poisoned(_) | channels::CallError::Interrupted => Error::Poisoned,
            channels::CallError::Unanswered => Error::Unanswered,
        }
    }
}

impl From<channels::TryRecvError> for Error {
    fn from(error: channels::TryRecvError) -> Error {
        match error {
            channels::TryRecvError::Empty => Error::Empty,
            channels::TryRecvError::Poisoned => Error::Poisoned,
            channels::TryRecvError::Closed => Error::Closed,
        }
    }
}

impl<T> From<channels::SendTimeoutError<T>> for Error {
    fn from(error: channels::SendTimeoutError<T>) -> Error {
        match error {
            channels::SendTimeoutError::Timeout(_) => Error::Timeout,
            channels::SendTimeoutError::Closed(_) => Error::Closed,
            channels::SendTimeoutError::Poisoned(_) => Error::Poisoned,
        }
    }
}

impl From<channels::RecvTimeoutError> for Error {
    fn from(error: channels::RecvTimeoutError) -> Error {
        match error {
            channels::RecvTimeoutError::Timeout => Error::Timeout,
            channels::RecvTimeoutError::Closed => Error::Closed,
            channels::RecvTimeoutError::Poisoned => Error::Poisoned,
        }
    }
}

/// The guard that it may hold is dropped, which unlocks; the mutex stays marked.
impl<T> From<LockError<'_, T>> for Error {
    fn from(error: LockError<'_, T>) -> Error {
        match error {
            LockError::OwnerDied(_) => Error::OwnerDied,
            LockError::Poisoned => Error::Poisoned,
        }
    }
}

/// As of a [`LockError`].
impl<T> From<TryLockError<'_, T>> for Error {
    fn from(error: TryLockError<'_, T>) -> Error {
        match error {
            TryLockError::OwnerDied(_) => Error::OwnerDied,
            TryLockError::Locked => Error::Locked,
        }
    }
}

/// As of a [`LockError`].
impl<T> From<LockTimeoutError<'_, T>> for Error {
    fn from(error: LockTimeoutError<'_, T>) -> Error {
        match error {
            LockTimeoutError::Timeout => Error::Timeout,
            LockTimeoutError::OwnerDied(_) => Error::OwnerDied,
            LockTimeoutError::Poisoned => Error::Poisoned,
        }
    }
}

impl From<AcquireError> for Error {
    fn from(AcquireError: AcquireError) -> Error {
        Error::Poisoned
    }
}

impl From<AcquireTimeoutError> for Error {
    fn from(error: AcquireTimeoutError) -> Error {
        match error {
            AcquireTimeoutError::Timeout => Error::Timeout,
            AcquireTimeoutError::Poisoned => Error::Poisoned,
        }
    }
}

impl From<channels::BufferError> for Error {
    fn from(error: channels::BufferError) -> Error {
        Error::Setup(SetupError::System {
            message: error.to_string(),
        })
    }
}

#[cfg(unix)]
impl From<luna_executors::FileError> for Error {
    fn from(error: luna_executors::FileError) -> Error {
        Error::other(error)
    }
}

impl From<crate::parameters::DeclareError> for Error {
    fn from(error: crate::parameters::DeclareError) -> Error {
        Error::Setup(SetupError::Parameter(error))
    }
}

impl From<crate::parameters::SetError> for Error {
    fn from(error: crate::parameters::SetError) -> Error {
        Error::Setup(SetupError::Parameters(error))
    }
}

impl From<std::io::Error> for Error {
    fn from(error: std::io::Error) -> Error {
        Error::other(error)
    }
}
