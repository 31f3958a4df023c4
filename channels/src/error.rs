//! What can go wrong with an operation: one small type for each, and the value comes back.

use crate::wait_point::Ending;
use core::fmt;
use thiserror::Error;

macro_rules! gives_value_back {
    ($name:ident) => {
        impl<T> fmt::Debug for $name<T> {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                // Without the value, so that it need not be `Debug`.
                f.debug_struct(stringify!($name))
                    .field("reason", &format_args!("{self}"))
                    .finish_non_exhaustive()
            }
        }
    };
}

/// Sending failed: the value can no longer be received. The error returns it.
///
/// ```
/// let (sender, receiver) = luna_channels::channel::<u32>();
/// drop(receiver);
/// let error = sender.blocking_send(7).unwrap_err();
/// assert!(error.is_closed());
/// assert_eq!(error.into_inner(), 7);
/// ```
#[derive(Clone, PartialEq, Eq, Error)]
pub struct SendError<T> {
    /// The value that was not sent.
    pub value: T,
    /// Whether the channel, or the branch that sent, was poisoned; else the last receiver is gone.
    pub poisoned: bool,
}

impl<T> SendError<T> {
    /// The value that was not sent.
    pub fn into_inner(self) -> T {
        self.value
    }

    /// Whether the channel, or the branch that sent, was poisoned.
    pub fn is_poisoned(&self) -> bool {
        self.poisoned
    }

    /// Whether the last receiver is gone.
    pub fn is_closed(&self) -> bool {
        !self.poisoned
    }
}

impl<T> fmt::Display for SendError<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.poisoned {
            "sending to a poisoned channel"
        } else {
            "sending to a channel whose last receiver is gone"
        })
    }
}
gives_value_back!(SendError);

/// Receiving failed: no value will ever come.
///
/// As wide as a word, so that the result of a receive of a word lies in two registers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum RecvError {
    /// The channel, or the branch that received, was poisoned.
    #[error("receiving from a poisoned channel")]
    Poisoned,
    /// The last sender is gone, and all that it sent was received.
    #[error("receiving from a channel whose last sender is gone")]
    Closed,
}

impl RecvError {
    pub(crate) fn of(ending: Ending) -> Self {
        match ending {
            Ending::Poisoned => RecvError::Poisoned,
            _ => RecvError::Closed,
        }
    }

    /// Whether the channel, or the branch that received, was poisoned.
    pub fn is_poisoned(&self) -> bool {
        *self == RecvError::Poisoned
    }

    /// Whether the last sender is gone.
    pub fn is_closed(&self) -> bool {
        *self == RecvError::Closed
    }
}

/// Sending at once failed. The value is given back.
#[derive(Clone, PartialEq, Eq, Error)]
pub enum TrySendError<T> {
    /// No receiver waits, and there is no room in a buffer.
    #[error("sending at once, but no receiver waits and there is no room")]
    Full(T),
    /// The last receiver is gone.
    #[error("sending to a channel whose last receiver is gone")]
    Closed(T),
    /// The channel was poisoned.
    #[error("sending to a poisoned channel")]
    Poisoned(T),
}

impl<T> TrySendError<T> {
    /// The value that was not sent.
    pub fn into_inner(self) -> T {
        match self {
            TrySendError::Full(value)
            | TrySendError::Closed(value)
            | TrySendError::Poisoned(value) => value,
        }
    }

    /// Whether it might succeed later.
    pub fn is_full(&self) -> bool {
        matches!(self, TrySendError::Full(_))
    }

    /// Whether the last receiver is gone.
    pub fn is_closed(&self) -> bool {
        matches!(self, TrySendError::Closed(_))
    }

    /// Whether the channel was poisoned.
    pub fn is_poisoned(&self) -> bool {
        matches!(self, TrySendError::Poisoned(_))
    }
}

gives_value_back!(TrySendError);

/// Receiving at once failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum TryRecvError {
    /// No sender waits, and nothing is buffered.
    #[error("receiving at once, but no sender waits and nothing is buffered")]
    Empty,
    /// The channel was poisoned.
    #[error("receiving from a poisoned channel")]
    Poisoned,
    /// The last sender is gone, and all that it sent was received.
    #[error("receiving from a channel whose last sender is gone")]
    Closed,
}

impl TryRecvError {
    /// Whether it might succeed later.
    pub fn is_empty(&self) -> bool {
        *self == TryRecvError::Empty
    }

    /// Whether the channel was poisoned.
    pub fn is_poisoned(&self) -> bool {
        *self == TryRecvError::Poisoned
    }

    /// Whether the last sender is gone.
    pub fn is_closed(&self) -> bool {
        *self == TryRecvError::Closed
    }
}

/// Sending within a time failed. The value is given back.
#[derive(Clone, PartialEq, Eq, Error)]
pub enum SendTimeoutError<T> {
    /// No receiver took the value in time; it was withdrawn.
    #[error("sending, but no receiver took the value in time")]
    Timeout(T),
    /// The last receiver is gone.
    #[error("sending to a channel whose last receiver is gone")]
    Closed(T),
    /// The channel, or the branch that sent, was poisoned.
    #[error("sending to a poisoned channel")]
    Poisoned(T),
}

impl<T> SendTimeoutError<T> {
    /// The value that was not sent.
    pub fn into_inner(self) -> T {
        match self {
            SendTimeoutError::Timeout(value)
            | SendTimeoutError::Closed(value)
            | SendTimeoutError::Poisoned(value) => value,
        }
    }

    /// Whether the time ran out.
    pub fn is_timeout(&self) -> bool {
        matches!(self, SendTimeoutError::Timeout(_))
    }

    /// Whether the last receiver is gone.
    pub fn is_closed(&self) -> bool {
        matches!(self, SendTimeoutError::Closed(_))
    }

    /// Whether the channel, or the branch that sent, was poisoned.
    pub fn is_poisoned(&self) -> bool {
        matches!(self, SendTimeoutError::Poisoned(_))
    }
}

impl<T> From<SendError<T>> for SendTimeoutError<T> {
    fn from(error: SendError<T>) -> Self {
        if error.poisoned {
            SendTimeoutError::Poisoned(error.value)
        } else {
            SendTimeoutError::Closed(error.value)
        }
    }
}

gives_value_back!(SendTimeoutError);

/// Receiving within a time failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum RecvTimeoutError {
    /// No value came in time.
    #[error("receiving, but no value came in time")]
    Timeout,
    /// The channel, or the branch that received, was poisoned.
    #[error("receiving from a poisoned channel")]
    Poisoned,
    /// The last sender is gone, and all that it sent was received.
    #[error("receiving from a channel whose last sender is gone")]
    Closed,
}

impl RecvTimeoutError {
    /// Whether the time ran out.
    pub fn is_timeout(&self) -> bool {
        *self == RecvTimeoutError::Timeout
    }

    /// Whether the channel, or the branch that received, was poisoned.
    pub fn is_poisoned(&self) -> bool {
        *self == RecvTimeoutError::Poisoned
    }

    /// Whether the last sender is gone.
    pub fn is_closed(&self) -> bool {
        *self == RecvTimeoutError::Closed
    }
}

impl From<RecvError> for RecvTimeoutError {
    fn from(error: RecvError) -> Self {
        match error {
            RecvError::Poisoned => RecvTimeoutError::Poisoned,
            RecvError::Closed => RecvTimeoutError::Closed,
        }
    }
}

/// A buffer that cannot be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BufferError {
    /// Its capacity is zero. A channel without a buffer is a rendezvous: make it with `channel()`.
    #[error(
        "a buffer of capacity 0 was asked for: give it at least 1, or make a rendezvous with `channel()`"
    )]
    ZeroCapacity,
}

/// Why an operation has failed, whatever its direction.
pub trait Ended {
    /// Whether its channel was poisoned, and not closed. `None`: it gave up.
    fn poisoned(&self) -> Option<bool>;

    /// Whether the operation has communicated all the same: its result is not what it should be.
    fn has_communicated(&self) -> bool {
        false
    }
}

impl<T> Ended for SendError<T> {
    fn poisoned(&self) -> Option<bool> {
        Some(self.poisoned)
    }
}

impl<T> Ended for SendTimeoutError<T> {
    fn poisoned(&self) -> Option<bool> {
        (!self.is_timeout()).then(|| self.is_poisoned())
    }
}

impl Ended for RecvError {
    fn poisoned(&self) -> Option<bool> {
        Some(self.is_poisoned())
    }
}

impl Ended for RecvTimeoutError {
    fn poisoned(&self) -> Option<bool> {
        (!self.is_timeout()).then(|| self.is_poisoned())
    }
}

/// What an operation that is tried at once cannot get is what one with a timeout has not got in
/// time.
impl<T> From<SendTimeoutError<T>> for TrySendError<T> {
    fn from(error: SendTimeoutError<T>) -> Self {
        match error {
            SendTimeoutError::Timeout(value) => TrySendError::Full(value),
            SendTimeoutError::Closed(value) => TrySendError::Closed(value),
            SendTimeoutError::Poisoned(value) => TrySendError::Poisoned(value),
        }
    }
}

impl From<RecvTimeoutError> for TryRecvError {
    fn from(error: RecvTimeoutError) -> Self {
        match error {
            RecvTimeoutError::Timeout => TryRecvError::Empty,
            RecvTimeoutError::Poisoned => TryRecvError::Poisoned,
            RecvTimeoutError::Closed => TryRecvError::Closed,
        }
    }
}
