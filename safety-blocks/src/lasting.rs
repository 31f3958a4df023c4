//! How long something has lasted.

use std::time::Duration;

/// Measures how long a condition has lasted, from the first sample that shows it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Lasting {
    since: Option<Duration>,
}

impl Lasting {
    /// Takes whether the condition holds, `elapsed` after the sample before. Returns for how long
    /// it has held.
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

/// Detects that a value has stood still for some time while it was driven.
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

    /// Takes the value, and whether it is driven from now on. Returns for how long it has stood
    /// still, if that is too long.
    pub(crate) fn step(
        &mut self,
        value: f64,
        is_driven: bool,
        elapsed: Duration,
    ) -> Option<Duration> {
        let rests = self
            .anchor
            .is_some_and(|anchor| (value - anchor).abs() <= self.band);
        // The new drive acts from now on: the time before belongs to the previous one.
        let was_driven = std::mem::replace(&mut self.was_driven, is_driven);
        if !rests || !was_driven {
            (self.anchor, self.since) = (Some(value), Duration::ZERO);
            return None;
        }
        self.since = self.since.saturating_add(elapsed);
        (self.since >= self.time).then_some(self.since)
    }

    /// Corrects whether the value is driven since the last sample.
    pub(crate) fn drive(&mut self, is_driven: bool) {
        self.was_driven = is_driven;
    }

    pub(crate) fn reset(&mut self) {
        (self.anchor, self.was_driven, self.since) = (None, false, Duration::ZERO);
    }
}
