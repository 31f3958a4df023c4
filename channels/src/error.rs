//! What can go wrong with an operation: one small type for each, and the value comes back.

use crate::wait_point::Ending;
use core::fmt;
use thiserror::Error;

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
luna_platform::debug_fields!(impl[T] SendError<T>, |error| reason: format_args!("{error}"));

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

/// Why an operation failed that gives up: as the first variant, or as a plain one fails. A send
/// gives its value back.
macro_rules! gives_up {
    (
        $(#[$about:meta])* $name:ident<$($T:ident)?>: $doing:literal, $other:literal,
        #[$closed:meta] $(#[$variant:meta])* $gave_up:ident, $(#[$asked:meta])* $has:ident
    ) => {
        $(#[$about])*
        #[derive(Clone, PartialEq, Eq, Error)]
        pub enum $name<$($T)?> {
            $(#[$variant])*
            $gave_up$(($T))?,
            #[$closed]
            #[error("{} a channel whose last {} is gone", $doing, $other)]
            Closed$(($T))?,
            /// The channel, or the branch that tried, was poisoned.
            #[error("{} a poisoned channel", $doing)]
            Poisoned$(($T))?,
        }

        impl<$($T)?> $name<$($T)?> {
            $(#[$asked])*
            pub fn $has(&self) -> bool {
                matches!(self, Self::$gave_up { .. })
            }

            /// Whether the last end of the other kind is gone.
            pub fn is_closed(&self) -> bool {
                matches!(self, Self::Closed { .. })
            }

            /// Whether the channel, or the branch that tried, was poisoned.
            pub fn is_poisoned(&self) -> bool {
                matches!(self, Self::Poisoned { .. })
            }

            $(
                /// The value that was not sent.
                pub fn into_inner(self) -> $T {
                    match self {
                        Self::$gave_up(value) | Self::Closed(value) | Self::Poisoned(value) => value,
                    }
                }
            )?
        }

        impl<$($T)?> Ended for $name<$($T)?> {
            fn poisoned(&self) -> Option<bool> {
                (!self.$has()).then(|| self.is_poisoned())
            }
        }

        $(luna_platform::debug_fields!(impl[$T] $name<$T>, |error| reason: format_args!("{error}"));)?
    };
}

gives_up! {
    /// Sending at once failed. The value is given back.
    TrySendError<T>: "sending to", "receiver",
    /// The last receiver is gone.
    /// No receiver waits, and there is no room in a buffer.
    #[error("sending at once, but no receiver waits and there is no room")]
    Full,
    /// Whether it might succeed later.
    is_full
}

gives_up! {
    /// Sending within a time failed. The value is given back.
    SendTimeoutError<T>: "sending to", "receiver",
    /// The last receiver is gone.
    /// No receiver took the value in time; it was withdrawn.
    #[error("sending, but no receiver took the value in time")]
    Timeout,
    /// Whether the time ran out.
    is_timeout
}

gives_up! {
    /// Receiving at once failed.
    #[derive(Debug, Copy)]
    TryRecvError<>: "receiving from", "sender",
    /// The last sender is gone, and all that it sent was received.
    /// No sender waits, and nothing is buffered.
    #[error("receiving at once, but no sender waits and nothing is buffered")]
    Empty,
    /// Whether it might succeed later.
    is_empty
}

gives_up! {
    /// Receiving within a time failed.
    #[derive(Debug, Copy)]
    RecvTimeoutError<>: "receiving from", "sender",
    /// The last sender is gone, and all that it sent was received.
    /// No value came in time.
    #[error("receiving, but no value came in time")]
    Timeout,
    /// Whether the time ran out.
    is_timeout
}

impl<T> From<SendError<T>> for SendTimeoutError<T> {
    fn from(error: SendError<T>) -> Self {
        match error.poisoned {
            true => SendTimeoutError::Poisoned(error.value),
            false => SendTimeoutError::Closed(error.value),
        }
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

impl Ended for RecvError {
    fn poisoned(&self) -> Option<bool> {
        Some(self.is_poisoned())
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
