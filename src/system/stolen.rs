//! What a hypervisor takes from the cores, sampled by the thread that runs the system.
//!
//! The kernel reports it in a text that takes tens of microseconds to make, so it is not read on
//! the real-time path, also not about a cycle that is late already: the samples lie beside the
//! loops, and the report matches both by their times.

use crate::time::StolenTime;
use luna_machine::steal::StealMeter;
use luna_platform::clock::Instant;
use std::collections::VecDeque;
use std::time::Duration;

/// The time between two samples. At some 30 µs a sample this is 0.03 % of a core that is not a
/// real-time one.
const PAUSE: Duration = Duration::from_millis(100);

/// The same on a machine from which nothing has been stolen since it began: a real one, most
/// likely.
const LONG_PAUSE: Duration = Duration::from_secs(1);

/// The most windows that are kept: those in which something was stolen, the last ones.
const KEPT: usize = 4096;

/// Highest number of cores reported for one sample: they go where changes of the safety state go
/// too, which has room for 64.
const MAX_REPORTED: usize = 16;

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
pub(super) struct Window {
    pub(super) core: usize,
    from: Instant,
    until: Instant,
    pub(super) stolen: Duration,
}

impl Window {
    pub(super) fn length(&self) -> Duration {
        self.until - self.from
    }

    /// What was stolen between the two instants at least: what cannot have been stolen in the rest
    /// of the window.
    fn stolen_at_least(&self, from: Instant, until: Instant) -> Duration {
        let rest = self.length() - (self.until.min(until) - self.from.max(from));
        self.stolen.saturating_sub(rest)
    }
}

impl Stolen {
    /// Takes the first sample.
    pub(super) fn begin() -> Self {
        Self::of(StealMeter::open())
    }

    fn of(mut meter: Option<StealMeter>) -> Self {
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

    /// Takes a sample if it is time to, as [`sample`](Self::sample); gives when the next one is.
    pub(super) fn sample_if_due(&mut self, report: impl FnMut(&Window)) -> Instant {
        if self.meter.is_none() {
            return Instant::NEVER;
        }
        if Instant::now() >= self.sampled + self.pause() {
            self.sample(report);
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

    /// Takes a sample, and reports the cores from which time was stolen since the one before:
    /// [`MAX_REPORTED`] at most, those that have lost most.
    pub(super) fn sample(&mut self, report: impl FnMut(&Window)) {
        if let Some(meter) = &mut self.meter {
            let read = meter.read();
            let now = Instant::now();
            self.add(read, now, report);
        }
    }

    fn add(&mut self, read: Vec<(usize, Duration)>, now: Instant, report: impl FnMut(&Window)) {
        let mut windows = Vec::new();
        for &(core, stolen) in &read {
            let before = self.last.iter().find(|(other, _)| *other == core);
            // A core that was just switched on has no past.
            let stolen =
                before.map_or(Duration::ZERO, |(_, before)| stolen.saturating_sub(*before));
            if stolen.is_zero() {
                continue;
            }
            windows.push(Window {
                core,
                from: self.sampled,
                until: now,
                stolen,
            });
        }
        windows.sort_by_key(|window| std::cmp::Reverse(window.stolen));
        windows.iter().take(MAX_REPORTED).for_each(report);
        self.windows.extend(windows);
        while self.windows.len() > KEPT {
            if let Some(forgotten) = self.windows.pop_front() {
                self.complete_since = forgotten.until;
            }
        }
        self.last = read;
        self.sampled = now;
    }

    /// What was stolen from `core` between the two instants, as far as the windows that touch that
    /// time show; `None` if that is not known.
    pub(super) fn between(&self, core: usize, from: Instant, until: Instant) -> Option<StolenTime> {
        let is_known = self.last.iter().any(|(known, _)| *known == core)
            && self.complete_since <= from
            && until <= self.sampled;
        let touched = self
            .windows
            .iter()
            .filter(|window| window.core == core && window.from < until && from < window.until);
        is_known.then(|| {
            touched.fold(StolenTime::default(), |all, window| StolenTime {
                at_least: all.at_least + window.stolen_at_least(from, until),
                at_most: all.at_most + window.stolen,
            })
        })
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

    fn at_most(stolen: &Stolen, core: usize, from: u64, until: u64) -> Option<Duration> {
        let both = stolen.between(core, at(from), at(until));
        both.map(|both| both.at_most)
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
        stolen.add(vec![(0, ms(1000)), (1, ms(70))], at(200), |_| ());
        stolen.add(vec![(0, ms(1010)), (1, ms(70))], at(300), |_| ());
        assert_eq!(at_most(&stolen, 1, 150, 151), Some(ms(20)));
        assert_eq!(at_most(&stolen, 1, 210, 220), Some(Duration::ZERO));
        assert_eq!(at_most(&stolen, 0, 190, 210), Some(ms(10)));
        assert_eq!(at_most(&stolen, 0, 110, 120), Some(Duration::ZERO));
    }

    #[test]
    fn of_a_window_what_fits_nowhere_else_was_stolen_at_least() {
        let mut stolen = begun();
        stolen.add(vec![(0, ms(1070)), (1, ms(50))], at(200), |_| ());
        stolen.add(vec![(0, ms(1080)), (1, ms(50))], at(300), |_| ());
        let at_least = |from, until| {
            let both = stolen.between(0, at(from), at(until));
            both.map(|both| both.at_least)
        };
        assert_eq!(at_least(110, 120), Some(Duration::ZERO));
        assert_eq!(
            at_least(110, 150),
            Some(ms(10)),
            "60 of 70 may have been before or after"
        );
        assert_eq!(at_least(100, 300), Some(ms(80)));
        assert_eq!(at_least(150, 299), Some(ms(20 + 9)));
    }

    #[cfg(all(target_os = "linux", not(luna_portable)))]
    #[test]
    fn what_the_kernel_tells_is_told_of_its_core() {
        let path = std::env::temp_dir().join(format!("luna-stolen-{}", std::process::id()));
        let cores = |first: u64, second: u64| {
            let text = format!(
                "cpu  1 2 3 4 5 6 7 {} 0 0\ncpu0 1 2 3 4 5 6 7 {first} 0 0\ncpu1 1 2 3 4 5 6 7 {second} 0 0\nintr 1 2 3\n",
                first + second
            );
            std::fs::write(&path, text).unwrap();
        };
        cores(100, 0);
        let mut stolen = Stolen::of(StealMeter::open_at(&path));
        let tick = stolen.last[0].1 / 100;
        assert!(!tick.is_zero());
        let mut reported = Vec::new();
        let mut sample = |stolen: &mut Stolen| {
            stolen.sample(|window| {
                assert_eq!(window.until, window.from + window.length());
                reported.push((window.core, window.stolen));
            });
            stolen.sampled
        };
        let first = sample(&mut stolen);
        cores(103, 0);
        let second = sample(&mut stolen);
        cores(103, 2);
        let third = sample(&mut stolen);
        std::fs::remove_file(&path).unwrap();
        assert_eq!(reported, [(0, 3 * tick), (1, 2 * tick)]);
        let most = |core, from, until| {
            let both = stolen.between(core, from, until);
            both.map(|both| both.at_most)
        };
        // Both are known of the times in which they were taken, and of no others.
        assert_eq!(most(0, first, second), Some(3 * tick));
        assert_eq!(most(1, first, second), Some(Duration::ZERO));
        assert_eq!(most(0, second, third), Some(Duration::ZERO));
        assert_eq!(most(1, second, third), Some(2 * tick));
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
        stolen.add(vec![(0, ms(1000)), (2, ms(9000))], at(200), |_| ());
        assert_eq!(stolen.between(0, at(99), at(110)), None, "before");
        assert_eq!(stolen.between(0, at(190), at(201)), None, "after");
        assert_eq!(stolen.between(1, at(110), at(120)), None, "switched off");
        assert_eq!(
            at_most(&stolen, 2, 110, 120),
            Some(Duration::ZERO),
            "switched on: its past is not this window's"
        );
    }

    #[test]
    fn the_oldest_windows_are_forgotten_and_not_denied() {
        let mut stolen = begun();
        for n in 1..=KEPT as u64 + 1 {
            stolen.add(vec![(0, ms(1000 + 10 * n))], at(100 + 100 * n), |_| ());
        }
        assert_eq!(stolen.between(0, at(110), at(120)), None);
        assert_eq!(at_most(&stolen, 0, 210, 220), Some(ms(10)));
    }
}
