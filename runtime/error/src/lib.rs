//! Errors: [`Error`] for all that a process' body and a system can meet, and its parts.
//!
//! Each error of a channel, lock or set-up turns into an [`Error`] with `?`. Errors of one
//! operation are with it: in `channel`, `sync`,
//! `parameters` and so on.

mod convert;
mod deadlock;
#[cfg(unix)]
mod device;
mod setup;
mod several;

#[cfg(not(feature = "logger"))]
mod no_logger;

pub use deadlock::{Deadlock, Operation, Partner, Wait};
#[cfg(unix)]
pub use device::{DeviceError, Holder};
pub use luna_config::file::Problem;
#[cfg(feature = "logger")]
pub use luna_logger::RegisterError;
#[cfg(not(feature = "logger"))]
pub use no_logger::RegisterError;
pub use setup::{BudgetKind, SetupError};
#[doc(hidden)]
pub use several::Failures;
pub use several::{Errors, Several};

use luna_platform::clock::Instant;
use luna_replay::RecordError;
use std::fmt;
use std::panic::{RefUnwindSafe, UnwindSafe};
use std::sync::Arc;
use std::time::Duration;

/// What a process' body, a construct, or a system returns.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What can go wrong in a process or a system. Every error of a channel turns into it with `?`.
///
/// Its `Debug` is its `Display`: a `main` that returns it and an `unwrap` print the text and the
/// remedy. An error of your own becomes one with `.map_err(luna::Error::other)?`.
///
/// Two errors are equal if they have the same content; two of [`Other`](Error::Other), which may
/// hold what is not comparable, if they are the same one.
#[derive(Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The channel was poisoned, or a sibling in a parallel construct failed.
    #[error("the channel is poisoned, or a sibling in a parallel construct has failed")]
    Poisoned,
    /// The other ends of the channel are gone.
    #[error("the other ends of the channel are gone")]
    Closed,
    /// A send that does not wait: no receiver waits, and there is no room.
    #[error("no receiver waits and there is no room")]
    Full,
    /// Receiving at once: nothing is there.
    #[error("no sender waits and nothing is buffered")]
    Empty,
    /// A call that its server has taken and dropped without a reply.
    #[error("the server has dropped the call without a reply")]
    Unanswered,
    /// The time ran out.
    #[error("the time ran out")]
    Timeout,
    /// A lock that does not wait: the mutex is held.
    #[error("the mutex is locked")]
    Locked,
    /// A mutex's owner has died while it held it: see `OwnerDied`.
    #[error(
        "a process ended while it held the mutex, and the guarded value may be incomplete: take the guard from the error of `lock`, and recover it"
    )]
    OwnerDied,
    /// A process failed.
    #[error("process `{name}`: {source}")]
    Process {
        /// The process' name.
        name: String,
        /// With what.
        source: Box<Error>,
    },
    /// A process panicked, with this message.
    #[error("panicked: {0}")]
    Panicked(String),
    /// A callback of the timer manager panicked.
    #[error("timer callback `{name}` panicked: {message}")]
    Callback {
        /// The callback's name.
        name: String,
        /// The panic's words.
        message: String,
    },
    /// A process was cancelled before its body had ended.
    #[error("cancelled before its body had ended")]
    Cancelled,
    /// A periodic loop missed its slots too often in a row, by the limit that was set for it.
    #[error(
        "loop `{name}` was late {consecutive} cycles in a row, which is its limit: give it less to do, a longer \
                 period, a higher priority, or a greater limit"
    )]
    Overrun {
        /// The loop's name.
        name: String,
        /// How many cycles in a row were late.
        consecutive: u32,
    },
    /// A process took longer than its budget, and was ended for it, or the system was: see
    /// `OnOverrun`.
    #[error(
        "took {taken:?} for a {kind} whose budget is {budget:?}: give it less to do at a time, await in between, or move it to an \
                 executor of lower priority"
    )]
    BudgetOverrun {
        /// Of a poll, or of a cycle.
        kind: BudgetKind,
        /// The budget.
        budget: Duration,
        /// How long it took.
        taken: Duration,
    },
    /// Every process of a `strict` system waited for another one.
    #[error("{0}")]
    Deadlock(Box<Deadlock>),
    /// So many turns were taken at one instant of a virtual clock: see
    /// `System::most_turns_at_an_instant`.
    #[error(
        "{turns} turns were taken at one instant, {at:?}, the last one by process `{process}`: time does not move while \
                 anybody can run, so wait for something (or allow more turns by `most_turns_at_an_instant`)"
    )]
    Livelock {
        /// The process that had the last turn.
        process: String,
        /// How many there were.
        turns: u64,
        /// The instant.
        at: Instant,
    },
    /// The system could not be recorded or replayed, or its replay differs.
    #[error("{0}")]
    Record(#[from] RecordError),
    /// What was asked for cannot be set up.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// Several branches of a parallel construct failed: see [`Error::errors`].
    #[error(transparent)]
    Several(Several),
    /// A link to a file failed.
    #[cfg(unix)]
    #[error(transparent)]
    External(#[from] luna_external::LinkError),
    /// A device cannot be opened, or is lost.
    #[cfg(unix)]
    #[error(transparent)]
    Device(Arc<DeviceError>),
    /// An error of the user's own about the system, as a text. The framework never makes one: what
    /// it cannot set up is [`Setup`](Error::Setup), with the values in fields.
    ///
    /// ```
    /// let error = luna::Error::System("no sensor answers on the bus".to_owned());
    /// assert_eq!(error.to_string(), "no sensor answers on the bus");
    /// assert_eq!(error, luna::Error::System("no sensor answers on the bus".into())); // by its text
    /// ```
    #[error("{0}")]
    System(String),
    /// An error of user code: see [`Error::other`].
    #[error(transparent)]
    Other(OtherError),
}

impl Error {
    /// An error of the user's own, from anything that is an error or a text.
    ///
    /// ```
    /// let error = luna::Error::other("the encoder does not answer");
    /// assert_eq!(error.to_string(), "the encoder does not answer");
    /// ```
    pub fn other(error: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Error {
        Error::Other(OtherError(Arc::from(error.into())))
    }

    /// All errors in it: those of the branches if it is [`Several`](Error::Several), in the order
    /// in which they are written, else itself.
    ///
    /// Real-time path: yes; O(1) a step, but O(branches) past branches that did not fail. No
    /// allocation.
    ///
    /// ```
    /// use luna::Error;
    /// use luna::prelude::*;
    ///
    /// let fails = async || Err::<(), _>(Error::other("the cause"));
    /// let error = luna::run(async { par!(fails(), async { Ok(()) }, async { Err::<(), _>(Error::Timeout) }).await }).unwrap_err();
    /// let texts: Vec<String> = error.errors().map(Error::to_string).collect();
    /// assert_eq!(texts, ["the cause", "the time ran out"]);
    /// assert_eq!(Error::Closed.errors().count(), 1);
    /// ```
    pub fn errors(&self) -> Errors<'_> {
        Errors::of(self)
    }

    /// Whether it comes from poison, however deep. Of several errors the first one in written order
    /// is asked.
    ///
    /// ```
    /// let deep = luna::Error::Process { name: "drive".into(), source: Box::new(luna::Error::Poisoned) };
    /// assert!(deep.is_poisoned());
    /// ```
    pub fn is_poisoned(&self) -> bool {
        matches!(self.innermost(), Error::Poisoned)
    }

    /// Whether it comes from a closed channel, however deep. Of several errors the first one in
    /// written order is asked.
    pub fn is_closed(&self) -> bool {
        matches!(self.innermost(), Error::Closed)
    }

    fn innermost(&self) -> &Error {
        match self {
            Error::Process { source, .. } => source.innermost(),
            Error::Several(several) => several.first().innermost(),
            error => error,
        }
    }

    #[doc(hidden)]
    pub fn in_process(self, name: &str) -> Error {
        Error::Process {
            name: name.to_owned(),
            source: Box::new(self),
        }
    }
}

impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// An error of user code. Two are equal if they are the same one.
#[derive(Clone, thiserror::Error)]
#[error(transparent)]
pub struct OtherError(Arc<dyn std::error::Error + Send + Sync>);

impl OtherError {
    /// The error that it was made of.
    pub fn get(&self) -> &(dyn std::error::Error + Send + Sync + 'static) {
        &*self.0
    }
}

impl PartialEq for OtherError {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Eq for OtherError {}

// It is shared and never changed: code that catches a panic finds it as it was made, whatever the
// user's error is.
impl UnwindSafe for OtherError {}
impl RefUnwindSafe for OtherError {}

impl fmt::Debug for OtherError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.0, f)
    }
}
