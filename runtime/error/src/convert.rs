//! What turns into an [`Error`] with `?`.

use crate::{Error, SetupError};
use luna_channels as channels;
use luna_channels::lock_sync::{
    AcquireError, AcquireTimeoutError, LockError, LockTimeoutError, TryLockError,
};
use luna_config::deployment::DeploymentError;
use luna_core::Nested;
#[cfg(unix)]
use luna_external::WireStop;
use luna_machine::memory::HeapError;
use luna_machine::shortfall::Shortfall;
use luna_machine::signals::SignalError;
use luna_platform::thread::{AttributeError, SpawnError};
use std::convert::Infallible;

/// One `From` for each error of an operation or of a set-up: the arms of its `match`.
macro_rules! from {
    ($($(#[$attribute:meta])* $from:ty $(where $generic:ident)? { $($found:pat => $error:expr),+ })+) => {$(
        $(#[$attribute])*
        impl$(<$generic>)? From<$from> for Error {
            fn from(error: $from) -> Error {
                match error { $($found => $error),+ }
            }
        }
    )+};
}

from! {
    channels::SendError<T> where T {
        channels::SendError { poisoned: true, .. } => Error::Poisoned,
        channels::SendError { .. } => Error::Closed
    }
    channels::RecvError {
        channels::RecvError::Poisoned => Error::Poisoned,
        channels::RecvError::Closed => Error::Closed
    }
    channels::TrySendError<T> where T {
        channels::TrySendError::Full(_) => Error::Full,
        channels::TrySendError::Closed(_) => Error::Closed,
        channels::TrySendError::Poisoned(_) => Error::Poisoned
    }
    channels::TryRecvError {
        channels::TryRecvError::Empty => Error::Empty,
        channels::TryRecvError::Poisoned => Error::Poisoned,
        channels::TryRecvError::Closed => Error::Closed
    }
    channels::SendTimeoutError<T> where T {
        channels::SendTimeoutError::Timeout(_) => Error::Timeout,
        channels::SendTimeoutError::Closed(_) => Error::Closed,
        channels::SendTimeoutError::Poisoned(_) => Error::Poisoned
    }
    channels::RecvTimeoutError {
        channels::RecvTimeoutError::Timeout => Error::Timeout,
        channels::RecvTimeoutError::Closed => Error::Closed,
        channels::RecvTimeoutError::Poisoned => Error::Poisoned
    }
    channels::CallError<Q> where Q {
        channels::CallError::Closed(_) => Error::Closed,
        channels::CallError::Poisoned(_) | channels::CallError::Interrupted => Error::Poisoned,
        channels::CallError::Unanswered => Error::Unanswered
    }
    // The guard that an error of a lock may hold is dropped, which unlocks; the mutex stays marked.
    LockError<'_, T> where T {
        LockError::OwnerDied(_) => Error::OwnerDied,
        LockError::Poisoned => Error::Poisoned
    }
    TryLockError<'_, T> where T {
        TryLockError::OwnerDied(_) => Error::OwnerDied,
        TryLockError::Locked => Error::Locked
    }
    LockTimeoutError<'_, T> where T {
        LockTimeoutError::Timeout => Error::Timeout,
        LockTimeoutError::OwnerDied(_) => Error::OwnerDied,
        LockTimeoutError::Poisoned => Error::Poisoned
    }
    AcquireError { AcquireError => Error::Poisoned }
    AcquireTimeoutError {
        AcquireTimeoutError::Timeout => Error::Timeout,
        AcquireTimeoutError::Poisoned => Error::Poisoned
    }

    AttributeError { error => SetupError::Attributes(error).into() }
    Nested { Nested => SetupError::Nested.into() }
    DeploymentError { error => SetupError::from(error).into() }
    channels::BufferError { error => SetupError::system(error).into() }
    HeapError { error => SetupError::system(error).into() }
    SignalError { error => SetupError::system(error).into() }
    crate::RegisterError { error => SetupError::Signal(error).into() }
    luna_config::parameters::DeclareError { error => SetupError::Parameter(error).into() }
    luna_config::parameters::SetError { error => SetupError::Parameters(error).into() }
    #[cfg(unix)]
    crate::DeviceError { error => Error::Device(error.into()) }
    #[cfg(unix)]
    luna_core::FileError { error => Error::other(error) }
    #[cfg(unix)]
    WireStop {
        WireStop::Failed(error) => error.into(),
        WireStop::Ended(channels::ChannelEnd::Closed) => Error::Closed,
        WireStop::Ended(channels::ChannelEnd::Poisoned) => Error::Poisoned
    }
    #[cfg(unix)]
    luna_external::BadRecord { error => Error::other(error) }
    #[cfg(unix)]
    luna_external::Malformed { error => Error::other(error) }
    luna_core::DriveError { error => Error::other(error) }
    luna_platform::thread::PolicyError { error => Error::other(error) }
    #[cfg(feature = "logger")]
    luna_logger::StartError { error => Error::other(error) }
    std::io::Error { error => Error::other(error) }
}

impl From<DeploymentError> for SetupError {
    fn from(error: DeploymentError) -> SetupError {
        match error {
            DeploymentError::File { path, message } => SetupError::DeploymentFile { path, message },
            DeploymentError::Wrong(problem) => SetupError::Deployment(problem),
        }
    }
}

impl SetupError {
    #[doc(hidden)]
    pub fn system(error: impl ToString) -> SetupError {
        SetupError::System {
            message: error.to_string(),
        }
    }
}

impl Error {
    /// A thread of `of` that did not start.
    #[doc(hidden)]
    pub fn not_started(of: &str, error: SpawnError<Infallible>) -> Error {
        Error::Setup(match error {
            SpawnError::Attributes(error) => SetupError::Attributes(error),
            SpawnError::Refused(refusal) => SetupError::Refused {
                of: of.to_owned(),
                shortfall: Shortfall::of(&refusal),
            },
            other => SetupError::Thread {
                message: other.to_string(),
            },
        })
    }
}
