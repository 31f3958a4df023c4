//! How long something has lasted.

use std::time::Duration;

/// Tells when something has lasted for a time: counted from the first sample that shows it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Lasting {
    since: Option<Duration>,
}

impl Lasting {
    /// Takes in whether it is so, `elapsed` after the sample before; gives for how long it has been.
    pub(crate) fn step(&mut self, is_so: bool, elapsed: Duration) -> Option<Duration> {
        self.since = is_so.then(|| match self.since {
            None => Duration::ZERO,
            Some(since) => since.saturating_add(elapsed),
        });
        self.since
    }

    pub(crate) fn reset(&mut self) {
        self.since = None;
    }
}

/// Tells when a value has stood still for a time while something drove it.
#[derive(Debug, Clone)]
pub(crate) struct Still {
    band: f64,
    time: Duration,
    /// Where it last moved to, or was last not driven.
    anchor: Option<f64>,
    was_driven: bool,
    since: Duration,
}

impl Still {
    pub(crate) fn new(band: f64, time: Duration) -> Self {
        Self {
            band,
            time,
            anchor: None,
            was_driven: false,
            since: Duration::ZERO,
        }
    }

    /// Takes in the value, and whether it is driven from now on; gives for how long it has stood still, if that is too long.
    pub(crate) fn step(
        &mut self,
        value: f64,
        is_driven: bool,
        elapsed: Duration,
    ) -> Option<Duration> {
        let rests = self
            .anchor
            .is_some_and(|anchor| (value - anchor).abs() <= self.band);
        // What drives it now acts from now on: the time before belongs to what drove it then.
        let was_driven = std::mem::replace(&mut self.was_driven, is_driven);
        if !rests || !was_driven {
            (self.anchor, self.since) = (Some(value), Duration::ZERO);
            return None;
        }
        self.since = self.since.saturating_add(elapsed);
        (self.since >= self.time).then_some(self.since)
    }

    /// Says what drives the value from the last sample on, other than was taken in with it.
    pub(crate) fn drive(&mut self, is_driven: bool) {
        self.was_driven = is_driven;
    }

    pub(crate) fn reset(&mut self) {
        (self.anchor, self.was_driven, self.since) = (None, false, Duration::ZERO);
    }
}
