//! The standard library has no timers that interrupt a thread.

use core::convert::Infallible;
use luna_platform::clock::Instant;

/// The alarm of a thread that waits for events. This backend has none: [`here`](Self::here) gives
/// nothing.
#[derive(Debug)]
pub struct EventAlarm {
    never: Infallible,
}

impl EventAlarm {
    /// Gives nothing.
    pub fn here() -> Option<EventAlarm> {
        None
    }

    /// There is none to be armed.
    #[must_use = "without an alarm the event is to be announced now"]
    pub fn arm(&self, _at: Instant) -> bool {
        match self.never {}
    }
}
