//! How a link is set up.

use luna::time::StampSource;
use std::time::Duration;

/// Of a [`CycleLink`](super::CycleLink) or a [`Protocol`](super::Protocol). Both computers may
/// differ in all of it.
///
/// ```
/// use luna_links::cycle::Settings;
/// use std::time::Duration;
///
/// let settings = Settings::new(Duration::from_millis(1)).stale_after(3).drift_ppm(50);
/// assert_eq!(settings.limit(), Duration::from_millis(3));
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    period: Duration,
    cycles: u32,
    pub(super) drift_ppm: u32,
    pub(super) stamps: StampSource,
}

impl Settings {
    /// For a partner that sends once in each `period`. Its values are stale after five periods
    /// without one, the clocks go apart by 200 parts per million at most, and stamps are of
    /// CLOCK_MONOTONIC.
    pub fn new(period: Duration) -> Self {
        Self {
            period,
            cycles: 5,
            drift_ppm: 200,
            stamps: StampSource::default(),
        }
    }

    /// After how many periods without a value the link is stale; 0 counts as 1. That is also how
    /// long a partner that was restarted is not heard, since until then the one before may live.
    #[must_use]
    pub fn stale_after(mut self, cycles: u32) -> Self {
        self.cycles = cycles.max(1);
        self
    }

    /// The greatest difference of the rates of both clocks, in parts per million. Quartzes differ by
    /// up to 100. A daemon that slews a clock may make it 500 for CLOCK_MONOTONIC too, chrony more
    /// (`maxslewrate`). Smaller numbers make smaller errors; too small ones make wrong errors, which
    /// are noticed and counted ([`Status::clock_steps`](super::Status::clock_steps)) as soon as two
    /// datagrams contradict each other.
    #[must_use]
    pub fn drift_ppm(mut self, ppm: u32) -> Self {
        self.drift_ppm = ppm;
        self
    }

    /// The clock of the stamps: what
    /// [`StampClock::source`](luna::time::StampClock::source) or
    /// [`System::stamp_clock`](luna::System::stamp_clock) has given.
    #[must_use]
    pub fn stamps(mut self, source: StampSource) -> Self {
        self.stamps = source;
        self
    }

    /// How long the partner may be silent.
    pub fn limit(&self) -> Duration {
        self.period.saturating_mul(self.cycles)
    }
}
