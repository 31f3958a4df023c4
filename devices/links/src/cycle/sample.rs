//! What comes out of a link.

use luna::Instant;
use luna::time::Stamp;
use std::time::Duration;

/// A time that was measured between two computers, and its error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Measured {
    /// The time.
    pub time: Duration,
    /// By how much it may be wrong, either way.
    pub error: Duration,
}

/// An instant of the partner on this computer's clock, and its error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Converted {
    /// The stamp, on this computer's clock.
    pub at: Stamp,
    /// By how much it may be wrong, either way.
    pub error: Duration,
}

/// A value of the partner: newer than every sample before it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Sample<T> {
    /// The value.
    pub value: T,
    /// Counts the values that the partner has sent, or tried to send, in its session.
    pub sequence: u64,
    /// How many values lie between the sample before and this one that will not come: lost, or
    /// overtaken. 0 for the first one of a session.
    pub lost_before: u64,
    /// How many older values came since the last sample that this one was preferred to by
    /// [`newest`](super::CycleLink::newest): they were received, and dropped.
    pub skipped: u64,
    /// The number of the partner's session: it counts up when the partner was restarted.
    pub session: u64,
    /// When the partner sent it, on the partner's clock.
    pub sent: Stamp,
    /// When it was received, on this computer's clock.
    pub received: Stamp,
    /// From its sending until it was received. None just after a clock was set.
    pub age: Option<Measured>,
    /// The slot of the partner's loop in which it was sent, if the partner has said so.
    pub tick: Option<Converted>,
}

/// A partner that is silent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct Silence {
    /// Since the last value, or since the link was opened.
    pub since: Instant,
    /// How long that may be.
    pub limit: Duration,
    /// Whether any value has come before.
    pub has_heard: bool,
}
