//! What a hypervisor takes from the cores, sampled by the thread that runs the system.
//!
//! The kernel tells it in a text that takes tens of microseconds to make, so it is not asked on the real-time path, also not about a cycle that is late
//! already: the samples lie beside the loops, and the report lays both together by their times.

use luna_platform::clock::Instant;
use luna_platform::steal::StealMeter;
use std::collections::VecDeque;
use std::time::Duration;

/// The time between two samples. At some 30 µs a sample this is 0.03 % of a core that is not a real-time one.
const PAUSE: Duration = Duration::from_millis(100);

/// The same on a machine from which nothing has been stolen since it began: a real one, most likely.
const LONG_PAUSE: Duration = Duration::from_secs(1);

/// The most windows that are kept: those in which something was stolen, the last ones.
const KEPT: usize = 4096;

/// The samples of one run.
pub(super) struct Stolen {
    meter: Option<StealMeter>,
    /// What was read last, and when.
    last: Vec<(usize, Duration)>,
    sampled: Instant,
    /// Since when all windows are kept.
    complete_since: Instant,
    windows: VecDeque<Window>,
}

/// Something was stolen from a core between two samples.
#[derive(Debug, Clone, Copy)]
struct Window {
    core: usize,
    from: Instant,
    until: Instant,
    stolen: Duration,
}

impl Stolen {
    /// Takes the first sample.
    pub(super) fn begin() -> Self {
        let mut meter = StealMeter::open();
        // Before the reading: what is read belongs to no earlier time.
        let now = Instant::now();
        Self {
            last: meter.as_mut().map(StealMeter::read).unwrap_or_default(),
            meter,
            sampled: now,
            complete_since: now,
            windows: VecDeque::new(),
        }
    }

    /// Takes a sample if it is time to; gives when the next one is.
    pub(super) fn sample_if_due(&mut self) -> Instant {
        if self.meter.is_none() {
            return Instant::NEVER;
        }
        if Instant::now() >= self.sampled + self.pause() {
            self.sample();
        }
        self.sampled + self.pause()
    }

    fn pause(&self) -> Duration {
        if self.last.iter().all(|(_, stolen)| stolen.is_zero()) {
            LONG_PAUSE
        } else {
            PAUSE
        }
    }

    /// Takes a sample.
    pub(super) fn sample(&mut self) {
        if let Some(meter) = &mut self.meter {
            let read = meter.read();
            let now = Instant::now();
            self.add(read, now);
        }
    }

    fn add(&mut self, read: Vec<(usize, Duration)>, now: Instant) {
        for &(core, stolen) in &read {
            let before = self.last.iter().find(|(other, _)| *other == core);
            // A core that was just switched on has no past.
            let stolen =
                before.map_or(Duration::ZERO, |(_, before)| stolen.saturating_sub(*before));
            if stolen.is_zero() {
                continue;
            }
            if self.windows.len() == KEPT
                && let Some(forgotten) = self.windows.pop_front()
            {
                self.complete_since = forgotten.until;
            }
            self.windows.push_back(Window {
                core,
                from: self.sampled,
                until: now,
                stolen,
            });
        }
        self.last = read;
        self.sampled = now;
    }

    /// What was stolen from `core` in the windows that touch the time between the two instants; `None` if that is not known.
    pub(super) fn between(&self, core: usize, from: Instant, until: Instant) -> Option<Duration> {
        let is_known = self.last.iter().any(|(known, _)| *known == core)
            && self.complete_since <= from
            && until <= self.sampled;
        let touched = self
            .windows
            .iter()
            .filter(|window| window.core == core && window.from < until && from < window.until);
        is_known.then(|| touched.map(|window| window.stolen).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::from_nanos(millis * 1_000_000)
    }

    fn ms(millis: u64) -> Duration {
        Duration::from_millis(millis)
    }

    fn begun() -> Stolen {
        Stolen {
            meter: None,
            last: vec![(0, ms(1000)), (1, ms(50))],
            sampled: at(100),
            complete_since: at(100),
            windows: VecDeque::new(),
        }
    }

    #[test]
    fn the_windows_around_count() {
        let mut stolen = begun();
        stolen.add(vec![(0, ms(1000)), (1, ms(70))], at(200));
        stolen.add(vec![(0, ms(1010)), (1, ms(70))], at(300));
        assert_eq!(stolen.between(1, at(150), at(151)), Some(ms(20)));
        assert_eq!(stolen.between(1, at(210), at(220)), Some(Duration::ZERO));
        assert_eq!(stolen.between(0, at(190), at(210)), Some(ms(10)));
        assert_eq!(stolen.between(0, at(110), at(120)), Some(Duration::ZERO));
    }

    #[test]
    fn a_machine_that_nobody_shares_is_asked_less_often() {
        let mut stolen = begun();
        assert_eq!(stolen.pause(), PAUSE);
        stolen.last = vec![(0, Duration::ZERO), (1, Duration::ZERO)];
        assert_eq!(stolen.pause(), LONG_PAUSE);
    }

    #[test]
    fn what_was_not_sampled_is_not_known() {
        let mut stolen = begun();
        stolen.add(vec![(0, ms(1000)), (2, ms(9000))], at(200));
        assert_eq!(stolen.between(0, at(99), at(110)), None, "before");
        assert_eq!(stolen.between(0, at(190), at(201)), None, "after");
        assert_eq!(stolen.between(1, at(110), at(120)), None, "switched off");
        assert_eq!(
            stolen.between(2, at(110), at(120)),
            Some(Duration::ZERO),
            "switched on: its past is not this window's"
        );
    }

    #[test]
    fn the_oldest_windows_are_forgotten_and_not_denied() {
        let mut stolen = begun();
        for n in 1..=KEPT as u64 + 1 {
            stolen.add(vec![(0, ms(1000 + 10 * n))], at(100 + 100 * n));
        }
        assert_eq!(stolen.between(0, at(110), at(120)), None);
        assert_eq!(stolen.between(0, at(210), at(220)), Some(ms(10)));
    }
}
