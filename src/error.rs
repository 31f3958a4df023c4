//! One error type for all that a process' body and a system can meet.

use crate::time::LoopName;
use luna_channels as channels;
use luna_executors::Nested;
use luna_platform::memory::HeapError;
use luna_platform::shortfall::Shortfall;
use luna_platform::signals::SignalError;
use luna_platform::thread::{AttributeError, SpawnError};
use std::convert::Infallible;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

/// What a process' body, a construct, or a system returns.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What can go wrong in a process or a system. Every error of a channel turns into it with `?`.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Error {
    /// The channel was poisoned, or a sibling in a parallel construct failed.
    Poisoned,
    /// The other ends of the channel are gone.
    Closed,
    /// Sending at once: nobody waits, and there is no room.
    Full,
    /// Receiving at once: nothing is there.
    Empty,
    /// The time ran out.
    Timeout,
    /// A process failed.
    Process {
        /// The process' name.
        name: String,
        /// With what.
        source: Box<Error>,
    },
    /// A process panicked, with this message.
    Panicked(String),
    /// A process was cancelled before its body had ended.
    Cancelled,
    /// A periodic loop missed its slots too often in a row, by the limit that was set for it.
    Overrun {
        /// The loop's name.
        name: String,
        /// How many cycles in a row were late.
        consecutive: u32,
    },
    /// What was asked for cannot be set up.
    Setup(SetupError),
    /// An error of the user's own: see [`Error::other`].
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

    /// Whether it comes from poison, however deep.
    ///
    /// ```
    /// let deep = luna::Error::Process { name: "drive".into(), source: Box::new(luna::Error::Poisoned) };
    /// assert!(deep.is_poisoned());
    /// ```
    pub fn is_poisoned(&self) -> bool {
        match self {
            Error::Poisoned => true,
            Error::Process { source, .. } => source.is_poisoned(),
            _ => false,
        }
    }

    /// Whether it comes from a closed channel, however deep.
    pub fn is_closed(&self) -> bool {
        match self {
            Error::Closed => true,
            Error::Process { source, .. } => source.is_closed(),
            _ => false,
        }
    }

    pub(crate) fn in_process(self, name: &str) -> Error {
        Error::Process { name: name.to_owned(), source: Box::new(self) }
    }

    pub(crate) fn overrun(name: LoopName, consecutive: u32) -> Error {
        Error::Overrun { name: name.as_str().to_owned(), consecutive }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Poisoned => f.write_str("the channel is poisoned, or a sibling in a parallel construct has failed"),
            Error::Closed => f.write_str("the other ends of the channel are gone"),
            Error::Full => f.write_str("nobody waits to receive and there is no room"),
            Error::Empty => f.write_str("nobody waits to send and nothing is buffered"),
            Error::Timeout => f.write_str("the time ran out"),
            Error::Process { name, source } => write!(f, "process `{name}`: {source}"),
            Error::Panicked(message) => write!(f, "panicked: {message}"),
            Error::Cancelled => f.write_str("cancelled before its body had ended"),
            Error::Overrun { name, consecutive } => write!(
                f,
                "loop `{name}` was late {consecutive} cycles in a row, which is its limit: give it less to do, a longer \
                 period, a higher priority, or a greater limit"
            ),
            Error::Setup(error) => error.fmt(f),
            Error::Other(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Error::Process { source, .. } => Some(source),
            Error::Setup(error) => error.source(),
            Error::Other(error) => error.0.source(),
            _ => None,
        }
    }
}

/// An error of the user's own. Two are equal if they are the same one.
#[derive(Clone)]
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

impl fmt::Debug for OtherError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.0, f)
    }
}

impl fmt::Display for OtherError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.0, f)
    }
}

/// What was asked for cannot be set up. Each says what failed, with which value, and what to do.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum SetupError {
    /// The machine has no such core.
    NoSuchCore {
        /// For which executor or thread.
        of: String,
        /// The core that was asked for.
        core: usize,
        /// The cores there are.
        available: Vec<usize>,
    },
    /// A thread's policy, priority, stack or name makes no sense.
    Attributes(AttributeError),
    /// A process' priority is not one of the 32 levels.
    Level {
        /// The process' name.
        process: String,
        /// The priority that was asked for.
        level: u8,
    },
    /// Two of a kind have one name.
    DuplicateName {
        /// Executor, process, or loop.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A loop's period is zero.
    ZeroPeriod {
        /// The loop's name.
        name: String,
    },
    /// A loop's period is longer than the clock reaches.
    PeriodTooLong {
        /// The loop's name.
        name: String,
        /// The period.
        period: Duration,
    },
    /// A loop's name does not fit in the room that is set aside before the start.
    NameTooLong {
        /// The name.
        name: String,
        /// The most bytes it may have.
        most: usize,
    },
    /// There are more loops than room for their statistics was set aside before the start.
    TooManyLoops {
        /// The loop that came last.
        name: String,
        /// How many there is room for.
        most: usize,
    },
    /// A loop was made outside of any process.
    NoProcess {
        /// The loop's name.
        name: String,
    },
    /// The system has been run already.
    AlreadyRun {
        /// The system's name.
        system: String,
    },
    /// The system has ended, or is about to.
    Ended {
        /// The system's name.
        system: String,
        /// What was to be started.
        process: String,
    },
    /// A system, or `luna::run`, was started inside a process.
    Nested,
    /// The system was to be strict, and this was refused.
    Refused {
        /// For which executor or thread, or for the whole system.
        of: String,
        /// What was refused, why, and how to get it.
        shortfall: Shortfall,
    },
    /// A thread could not be started.
    Thread {
        /// What the system said.
        message: String,
    },
    /// Memory or signals could not be prepared.
    System {
        /// What failed, and what to do.
        message: String,
    },
}

impl fmt::Display for SetupError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SetupError::NoSuchCore { of, core, available } => {
                write!(f, "`{of}` asks for core {core}, which this machine has not; choose one of {available:?}")
            }
            SetupError::Attributes(error) => error.fmt(f),
            SetupError::Level { process, level } => {
                write!(f, "process `{process}` asks for priority {level}; choose 0 (lowest) to 31")
            }
            SetupError::DuplicateName { kind, name } => {
                write!(f, "there is {kind} `{name}` already; give each {kind} a name of its own")
            }
            SetupError::ZeroPeriod { name } => write!(f, "loop `{name}` has a period of 0; give it at least 1 ns"),
            SetupError::PeriodTooLong { name, period } => {
                write!(f, "loop `{name}` has a period of {period:?}; the clock reaches 292 years")
            }
            SetupError::NameTooLong { name, most } => {
                write!(f, "the loop name `{name}` has {} bytes; use at most {most}", name.len())
            }
            SetupError::TooManyLoops { name, most } => write!(
                f,
                "loop `{name}` is one more than the {most} for which statistics were set aside; call System::max_loops \
                 before the start"
            ),
            SetupError::NoProcess { name } => {
                write!(f, "loop `{name}` was made outside of any process; call luna::periodic in a process or luna::run")
            }
            SetupError::AlreadyRun { system } => {
                write!(f, "system `{system}` has been run already; build another one to run again")
            }
            SetupError::Ended { system, process } => {
                write!(f, "system `{system}` ends or has ended, so process `{process}` cannot be started")
            }
            SetupError::Nested => f.write_str(
                "a system or luna::run was started inside a process, whose thread it would stop: await the work instead, or \
                 start it from a plain thread",
            ),
            SetupError::Refused { of, shortfall } => write!(f, "strict: {of}: {shortfall}"),
            SetupError::Thread { message } | SetupError::System { message } => f.write_str(message),
        }
    }
}

impl std::error::Error for SetupError {}

impl From<SetupError> for Error {
    fn from(error: SetupError) -> Error {
        Error::Setup(error)
    }
}

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
        Error::Setup(SetupError::System { message: error.to_string() })
    }
}

impl From<SignalError> for Error {
    fn from(error: SignalError) -> Error {
        Error::Setup(SetupError::System { message: error.to_string() })
    }
}

impl Error {
    /// A thread of `of` that did not start.
    pub(crate) fn not_started(of: &str, error: SpawnError<Infallible>) -> Error {
        Error::Setup(match error {
            SpawnError::Attributes(error) => SetupError::Attributes(error),
            SpawnError::Refused(shortfall) => SetupError::Refused { of: of.to_owned(), shortfall },
            other => SetupError::Thread { message: other.to_string() },
        })
    }
}

impl<T> From<channels::SendError<T>> for Error {
    fn from(error: channels::SendError<T>) -> Error {
        if error.poisoned { Error::Poisoned } else { Error::Closed }
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

impl From<channels::BufferError> for Error {
    fn from(error: channels::BufferError) -> Error {
        Error::Setup(SetupError::System { message: error.to_string() })
    }
}

impl From<std::io::Error> for Error {
    fn from(error: std::io::Error) -> Error {
        Error::other(error)
    }
}
