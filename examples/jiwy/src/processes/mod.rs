//! The code of each process between the channels that `network` gives it, in the order of a cycle.

pub(crate) mod control;
pub(crate) mod operator;
pub(crate) mod readers;
pub(crate) mod safety;
pub(crate) mod sanity;
pub(crate) mod timer;

use luna::Instant;
use std::time::Duration;

/// The time between the slots of a loop.
pub(crate) struct Slots {
    last: Option<Instant>,
    first: Duration,
}

impl Slots {
    /// The first slot counts as `first` after one that was not.
    pub(crate) fn new(first: Duration) -> Self {
        Self { last: None, first }
    }

    /// From the slot before to the one at `deadline`.
    pub(crate) fn elapsed(&mut self, deadline: Instant) -> Duration {
        self.last
            .replace(deadline)
            .map_or(self.first, |last| deadline - last)
    }
}
