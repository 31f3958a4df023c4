//! The standard library has no alarms, and neither has a port.

use crate::clock::Instant;
use crate::sync::{Arc, plain::AtomicU64};
use core::convert::Infallible;

/// The alarm of a thread. This backend has none: [`new`](Self::new) gives nothing.
#[derive(Debug)]
pub struct Alarm {
    never: Infallible,
}

impl Alarm {
    /// Gives nothing.
    pub fn new<T: Send + Sync + 'static>(
        _owner: Arc<T>,
        _word: impl FnOnce(&T) -> &AtomicU64,
        _bit: u64,
    ) -> Option<Alarm> {
        None
    }

    /// There is none to be armed.
    #[must_use = "without an alarm the clock is to be read"]
    pub fn arm(&self, _deadline: Instant) -> bool {
        match self.never {}
    }

    /// There is none to be disarmed.
    pub fn disarm(&self) {
        match self.never {}
    }

    /// There is none to be asked.
    pub fn take_rung(&self) -> Option<Instant> {
        match self.never {}
    }
}

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
