//! What a controller has done so far.

use crate::State;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};

/// Counters of a controller since it was created. Cloning is cheap. Reading is possible at any
/// time, on the real-time path too: O(1), one load.
#[derive(Clone, Default)]
pub struct Counts(Arc<Inner>);

#[derive(Default)]
struct Inner {
    sent: AtomicU64,
    received: AtomicU64,
    overruns: AtomicU64,
    malformed: AtomicU64,
    lost: AtomicU64,
    errors: AtomicU64,
    unreported: AtomicU64,
    dropped: AtomicU64,
    /// 0, or one more than the state.
    state: AtomicU8,
}

impl Counts {
    /// Frames that the port took. They were not on the bus yet.
    pub fn sent(&self) -> u64 {
        self.0.sent.load(Ordering::Relaxed)
    }

    /// Frames given to receivers; a frame for two counts twice.
    pub fn received(&self) -> u64 {
        self.0.received.load(Ordering::Relaxed)
    }

    /// Frames for which a receiver's channel had no room.
    pub fn overruns(&self) -> u64 {
        self.0.overruns.load(Ordering::Relaxed)
    }

    /// Frames that are none of their receiver's values.
    pub fn malformed(&self) -> u64 {
        self.0.malformed.load(Ordering::Relaxed)
    }

    /// Frames that were lost before: the queue of the kernel or of the hardware was full. Hardware
    /// does not say how many: each report counts as one.
    pub fn lost(&self) -> u64 {
        self.0.lost.load(Ordering::Relaxed)
    }

    /// Reports of errors on the bus.
    pub fn errors(&self) -> u64 {
        self.0.errors.load(Ordering::Relaxed)
    }

    /// Events for which their channel had no room, or that has no receiver. So for the reports of
    /// a [`HeartbeatConsumer`](crate::canopen::HeartbeatConsumer).
    pub fn unreported(&self) -> u64 {
        self.0.unreported.load(Ordering::Relaxed)
    }

    /// Frames that were not sent, since the node was bus-off: see
    /// [`OnBusOff::Wait`](crate::OnBusOff::Wait).
    pub fn dropped(&self) -> u64 {
        self.0.dropped.load(Ordering::Relaxed)
    }

    /// The error state of the node, as was reported last; none before the first report. Ports
    /// report changes: a node is likely to be active until then, but was not asked.
    pub fn state(&self) -> Option<State> {
        match self.0.state.load(Ordering::Relaxed) {
            0 => None,
            1 => Some(State::Active),
            2 => Some(State::Warning),
            3 => Some(State::Passive),
            _ => Some(State::BusOff),
        }
    }

    pub(crate) fn add_sent(&self) {
        self.0.sent.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn add_received(&self) {
        self.0.received.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn add_overrun(&self) {
        self.0.overruns.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn add_malformed(&self) {
        self.0.malformed.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn add_lost(&self, count: u64) {
        self.0.lost.fetch_add(count, Ordering::Relaxed);
    }

    pub(crate) fn add_error(&self) {
        self.0.errors.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn add_unreported(&self) {
        self.0.unreported.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn add_dropped(&self) {
        self.0.dropped.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn set_state(&self, state: State) {
        self.0.state.store(state as u8 + 1, Ordering::Relaxed);
    }
}

impl fmt::Debug for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Counts")
            .field("sent", &self.sent())
            .field("received", &self.received())
            .field("overruns", &self.overruns())
            .field("malformed", &self.malformed())
            .field("lost", &self.lost())
            .field("errors", &self.errors())
            .field("unreported", &self.unreported())
            .field("dropped", &self.dropped())
            .field("state", &self.state())
            .finish()
    }
}
