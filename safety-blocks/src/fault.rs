//! A fault, and the block that found it.

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

impl Which {
    fn name(self) -> &'static str {
        match self {
            Self::Value => "value",
            Self::Feedback => "feedback",
        }
    }
}

/// One of two channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Channel {
    /// The first.
    A,
    /// The second.
    B,
}

/// The fault, with value and limit. Units are those of the block's signals, rates are per second.
///
/// `Copy`, so that no step of its life allocates or frees.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// A value is not a number, or infinite.
    #[error("the {} is {value}", .which.name())]
    NotFinite {
        /// Which one.
        which: Which,
        /// What it is.
        value: f64,
    },
    /// There is no feedback: none has come yet, or the newest is too old.
    #[error("there is no feedback, or it is too old")]
    NoFeedback,
    /// A value is outside of its limits.
    #[error("{value} is outside of {min} to {max}")]
    OutOfRange {
        /// What it is.
        value: f64,
        /// The least that is allowed.
        min: f64,
        /// The most that is allowed.
        max: f64,
    },
    /// A value changes faster than it may.
    #[error("it changes by {rate:.3} a second, at most {limit} is allowed")]
    TooFast {
        /// How fast, by second; infinite if no time has passed.
        rate: f64,
        /// The fastest that is allowed, by second.
        limit: f64,
    },
    /// An output leads further into an end stop.
    #[error("at {position:.4} it is driven further into the end stop that begins at {stop}")]
    EndStop {
        /// Where the axis is.
        position: f64,
        /// Where the stop begins.
        stop: f64,
    },
    /// A sensor has returned the same value for too long.
    #[error("it has been {value} for {time:?}; check the sensor and its cable")]
    Frozen {
        /// The value.
        value: f64,
        /// For how long by now.
        time: Duration,
    },
    /// A sensor is too noisy.
    #[error(
        "its noise is {level}, at most {limit} is allowed; check the sensor, its shield and its supply"
    )]
    Noisy {
        /// The mean size of the second difference.
        level: f64,
        /// The largest that is allowed.
        limit: f64,
    },
    /// Two sensors, or two channels, disagree for too long.
    #[error("{value} and {other} have been further apart than {tolerance} for {time:?}")]
    Disagree {
        /// The first value.
        value: f64,
        /// The other value.
        other: f64,
        /// How far apart they may be.
        tolerance: f64,
        /// For how long they have been further apart.
        time: Duration,
    },
    /// An actuator is driven and does not move.
    #[error(
        "driven by {output} it has stayed at {position:.4} for {time:?}; check what blocks it, its motor and its encoder"
    )]
    Blocked {
        /// By what it is driven.
        output: f64,
        /// Where it is.
        position: f64,
        /// For how long by now.
        time: Duration,
    },
    /// Nothing has come for too long.
    #[error("nothing has come for {time:?}, at most {limit:?} is allowed")]
    Silent {
        /// For how long by now.
        time: Duration,
        /// The longest that is allowed.
        limit: Duration,
    },
    /// A dead-man's key was held when its writers ended: nothing can release it any more.
    #[error("the key was held when its writers ended; release it before they end")]
    KeyLost,
    /// One of two channels has no valid value.
    #[error("channel {channel:?} has no valid value")]
    Missing {
        /// Which one.
        channel: Channel,
    },
    /// A dead-man's key is not held.
    #[error("the key is not held")]
    Released,
    /// A dead-man's key is held for longer than it may.
    #[error("the key has been held for {time:?}, at most {limit:?} is allowed; release it")]
    HeldTooLong {
        /// For how long by now.
        time: Duration,
        /// The longest that is allowed.
        limit: Duration,
    },
}

/// A fault and the block that found it: the cause of an emergency.
///
/// In the error of [`System::run`](luna::System::run) it is the source in
/// [`Error::Other`](luna::Error::Other).
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("safety block `{block}`: {fault}")]
pub struct Finding {
    /// The block's name, as the set-up gave it.
    pub block: Arc<str>,
    /// What it found.
    #[source]
    pub fault: Fault,
}
