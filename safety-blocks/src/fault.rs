//! What a block found, and who found it.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

/// Which of the two values that a block sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Which {
    /// The one that passes through.
    Value,
    /// The one that it is compared with.
    Feedback,
}

/// One of two channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Channel {
    /// The first.
    A,
    /// The second.
    B,
}

/// What is wrong, with the value and the limit. Units are those of the block's signals, rates are by second.
///
/// `Copy`: it is made, passed on and dropped without memory.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Fault {
    /// A value is not a number, or infinite.
    NotFinite {
        /// Which one.
        which: Which,
        /// What it is.
        value: f64,
    },
    /// There is no feedback: none has come yet, or the newest is too old.
    NoFeedback,
    /// A value is outside of its limits.
    OutOfRange {
        /// What it is.
        value: f64,
        /// The least that is allowed.
        min: f64,
        /// The most that is allowed.
        max: f64,
    },
    /// A value changes faster than it may.
    TooFast {
        /// How fast, by second; infinite if no time has passed.
        rate: f64,
        /// The fastest that is allowed, by second.
        limit: f64,
    },
    /// An output leads further into an end stop.
    EndStop {
        /// Where the axis is.
        position: f64,
        /// Where the stop begins.
        stop: f64,
    },
    /// A sensor says the same for too long.
    Frozen {
        /// What it says.
        value: f64,
        /// For how long by now.
        time: Duration,
    },
    /// A sensor is too noisy.
    Noisy {
        /// The mean size of the second difference.
        level: f64,
        /// The largest that is allowed.
        limit: f64,
    },
    /// Two sensors, or two channels, disagree for too long.
    Disagree {
        /// What the first says.
        value: f64,
        /// What the other says.
        other: f64,
        /// How far apart they may be.
        tolerance: f64,
        /// For how long they have been further apart.
        time: Duration,
    },
    /// An actuator is driven and does not move.
    Blocked {
        /// By what it is driven.
        output: f64,
        /// Where it is.
        position: f64,
        /// For how long by now.
        time: Duration,
    },
    /// Nothing has come for too long.
    Silent {
        /// For how long by now.
        time: Duration,
        /// The longest that is allowed.
        limit: Duration,
    },
    /// One of two channels has no valid value.
    Missing {
        /// Which one.
        channel: Channel,
    },
    /// A dead-man's key is not held.
    Released,
    /// A dead-man's key is held for longer than it may.
    HeldTooLong {
        /// For how long by now.
        time: Duration,
        /// The longest that is allowed.
        limit: Duration,
    },
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite {
                which: Which::Value,
                value,
            } => write!(f, "the value is {value}"),
            Self::NotFinite {
                which: Which::Feedback,
                value,
            } => write!(f, "the feedback is {value}"),
            Self::NoFeedback => f.write_str("there is no feedback, or it is too old"),
            Self::OutOfRange { value, min, max } => {
                write!(f, "{value} is outside of {min} to {max}")
            }
            Self::TooFast { rate, limit } => {
                write!(
                    f,
                    "it changes by {rate:.3} a second, at most {limit} is allowed"
                )
            }
            Self::EndStop { position, stop } => write!(
                f,
                "at {position:.4} it is driven further into the end stop that begins at {stop}"
            ),
            Self::Frozen { value, time } => write!(
                f,
                "it has been {value} for {time:?}; look at the sensor and its cable"
            ),
            Self::Noisy { level, limit } => write!(
                f,
                "its noise is {level}, at most {limit} is allowed; look at the sensor, its shield and its supply"
            ),
            Self::Disagree {
                value,
                other,
                tolerance,
                time,
            } => write!(
                f,
                "{value} and {other} have been further apart than {tolerance} for {time:?}"
            ),
            Self::Blocked {
                output,
                position,
                time,
            } => write!(
                f,
                "driven by {output} it has stayed at {position:.4} for {time:?}; look what blocks it, at its motor and at its encoder"
            ),
            Self::Silent { time, limit } => write!(
                f,
                "nothing has come for {time:?}, at most {limit:?} is allowed"
            ),
            Self::Missing { channel } => {
                write!(f, "channel {channel:?} has no valid value")
            }
            Self::Released => f.write_str("the key is not held"),
            Self::HeldTooLong { time, limit } => write!(
                f,
                "the key has been held for {time:?}, at most {limit:?} is allowed; release it"
            ),
        }
    }
}

impl std::error::Error for Fault {}

/// A fault and the block that found it: what an emergency is raised with.
///
/// In the error of [`System::run`](luna::System::run) it is the source in [`Error::Other`](luna::Error::Other).
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The block's name, as the set-up gave it.
    pub block: Arc<str>,
    /// What it found.
    pub fault: Fault,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "safety block `{}`: {}", self.block, self.fault)
    }
}

impl std::error::Error for Finding {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        Some(&self.fault)
    }
}
