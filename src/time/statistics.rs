//! What is counted of a periodic loop.

use super::late::{LateCycles, Witness};
use super::late_cycle::LateCycle;
use super::registry::LoopName;
use hdrhistogram::Histogram;
use std::time::Duration;

/// A loop's statistics while it runs: owned by the loop alone, in memory that was set aside before
/// the start.
#[derive(Debug, Default)]
pub(crate) struct Statistics {
    pub(crate) name: LoopName,
    /// Its number among the system's loops, from 1.
    pub(crate) number: u32,
    /// All but what is known of late cycles.
    pub(crate) report: LoopReport,
    pub(crate) late: LateCycles,
}

impl Statistics {
    pub(crate) fn into_report(self, witness: &Witness<'_>) -> LoopReport {
        let (late, late_after) = self.late.summary();
        LoopReport {
            late,
            late_after,
            late_cycles: self.late.reports(witness),
            ..self.report
        }
    }
}

/// How a loop kept its time.
///
/// Of every grid of slots that the loop ran on, `kept + missed` is the time that elapsed on it
/// divided by the period, whole periods counted; so is it of their sums, with
/// [`slots_elapsed`](Self::slots_elapsed).
///
/// ```
/// use luna::prelude::*;
/// use std::time::Duration;
///
/// let mut system = System::new("servo");
/// let executor = system.executor("main").build()?;
/// executor.process("loop").spawn(async {
///     let mut tick = luna::periodic("loop", Duration::from_millis(1))?;
///     for _ in 0..5 {
///         tick.next().await;
///     }
///     Ok(())
/// })?;
/// let report = system.run()?;
/// let servo = &report.loops["loop"];
/// assert_eq!(servo.cycles, 5);
/// assert_eq!(servo.cycles + servo.missed, servo.slots_elapsed);
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct LoopReport {
    /// The loop's period.
    pub period: Duration,
    /// How often the loop ran: the slots it kept.
    pub cycles: u64,
    /// The slots that passed without a cycle.
    pub missed: u64,
    /// The slots that have come, from the clock: elapsed time divided by the period.
    pub slots_elapsed: u64,
    /// How many cycles ended after the next slot had begun.
    pub overruns: u64,
    /// From the scheduled slot to the body: the wake-up latency. After missed slots it counts from
    /// the first of them.
    pub wake_latency: Distribution,
    /// From one cycle's begin to the next one's.
    pub cycle_time: Distribution,
    /// From a cycle's begin until the loop requested the next.
    pub run_time: Distribution,
    /// From which lateness on a cycle is late: see
    /// [`Periodic::late_after`](crate::Periodic::late_after).
    pub late_after: Duration,
    /// How many cycles were late.
    pub late: u64,
    /// The latest of these, at most eight, the worst first, with what is known of the cause.
    pub late_cycles: Vec<LateCycle>,
}

/// The longest time that the histogram resolves: longer ones count as this long there. The exact
/// maximum is kept beside it.
const LONGEST: u64 = 1 << 37;

/// Times in nanoseconds: their number, exact minimum, maximum, mean and standard deviation, and
/// percentiles within 0.8 %.
///
/// Recording is O(1) and allocates nothing; the histogram (`hdrhistogram`, 2 significant digits, 1
/// ns to 137 s) is made before the start. Reading it is for after the run.
///
/// ```
/// use luna::prelude::*;
/// use std::time::Duration;
///
/// let mut system = System::new("ten cycles");
/// let executor = system.executor("main").build()?;
/// executor.process("loop").spawn(async {
///     let mut tick = luna::periodic("loop", Duration::from_millis(1))?;
///     for _ in 0..10 {
///         tick.next().await;
///     }
///     Ok(())
/// })?;
/// let report = system.run()?;
/// let latency = &report.loops["loop"].wake_latency;
/// assert_eq!(latency.count(), 10);
/// assert!(latency.min() <= latency.percentile(50.0) && latency.percentile(50.0) <= latency.max());
/// assert_eq!(latency.bins().map(|(_, count)| count).sum::<u64>(), 10);
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Distribution {
    histogram: Histogram<u32>,
    count: u64,
    minimum: u64,
    maximum: u64,
    /// Welford's running mean and sum of squared distances from it.
    mean: f64,
    squares: f64,
}

impl Default for Distribution {
    fn default() -> Self {
        let histogram = Histogram::new_with_bounds(1, LONGEST, 2)
            .expect("the bounds are constants that the crate accepts");
        Self {
            histogram,
            count: 0,
            minimum: u64::MAX,
            maximum: 0,
            mean: 0.0,
            squares: 0.0,
        }
    }
}

impl Distribution {
    /// What the histogram takes on the heap.
    #[cfg(test)]
    pub(crate) fn histogram_bytes(&self) -> usize {
        self.histogram.distinct_values() * size_of::<u32>()
    }

    /// Counts one time. O(1).
    #[inline]
    pub(crate) fn record(&mut self, nanos: u64) {
        self.histogram.saturating_record(nanos);
        self.count += 1;
        self.minimum = self.minimum.min(nanos);
        self.maximum = self.maximum.max(nanos);
        let distance = nanos as f64 - self.mean;
        self.mean += distance / self.count as f64;
        self.squares += distance * (nanos as f64 - self.mean);
    }

    /// How many were recorded.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The shortest; zero if none was recorded.
    pub fn min(&self) -> Duration {
        Duration::from_nanos(if self.count == 0 { 0 } else { self.minimum })
    }

    /// The longest.
    pub fn max(&self) -> Duration {
        Duration::from_nanos(self.maximum)
    }

    /// The mean, in nanoseconds.
    pub fn mean_nanos(&self) -> f64 {
        self.mean
    }

    /// The standard deviation, in nanoseconds.
    pub fn stddev_nanos(&self) -> f64 {
        if self.count < 2 {
            0.0
        } else {
            (self.squares / (self.count - 1) as f64).sqrt()
        }
    }

    /// The time that `percent` per cent of all do not exceed: 50 for the median. Within 0.8 %, and
    /// never beyond the exact extremes.
    pub fn percentile(&self, percent: f64) -> Duration {
        if self.count == 0 {
            return Duration::ZERO;
        }
        let nanos = self.histogram.value_at_percentile(percent);
        Duration::from_nanos(nanos.clamp(self.minimum, self.maximum))
    }

    /// The recorded times as pairs of (greatest nanoseconds of a bin, count), rising, without empty
    /// bins.
    pub fn bins(&self) -> impl Iterator<Item = (u64, u64)> + '_ {
        self.histogram
            .iter_recorded()
            .map(|bin| (bin.value_iterated_to(), bin.count_since_last_iteration()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The figure in the documentation of `System::max_loops`.
    #[test]
    fn the_room_of_a_loop_takes_about_50_kib() {
        let room = Statistics::default().report;
        let histograms = [&room.wake_latency, &room.cycle_time, &room.run_time]
            .map(Distribution::histogram_bytes);
        let bytes = size_of::<Statistics>() + histograms.iter().sum::<usize>();
        assert_eq!((bytes + 512) / 1024, 50, "{bytes}");
    }

    #[test]
    fn moments_are_exact_and_percentiles_close() {
        let mut times = Distribution::default();
        for nanos in 1..=10_000 {
            times.record(nanos);
        }
        assert_eq!(
            (
                times.count(),
                times.min().as_nanos(),
                times.max().as_nanos()
            ),
            (10_000, 1, 10_000)
        );
        assert!((times.mean_nanos() - 5000.5).abs() < 1e-6);
        assert!((times.stddev_nanos() - 2_886.895_68).abs() < 1e-3);
        let median = times.percentile(50.0).as_nanos() as f64;
        assert!((median / 5000.0 - 1.0).abs() < 0.008, "{median}");
        assert_eq!(times.bins().map(|(_, count)| count).sum::<u64>(), 10_000);
    }

    #[test]
    fn extremes_beyond_the_histogram_are_kept() {
        let mut times = Distribution::default();
        assert_eq!(
            (times.min(), times.percentile(99.0)),
            (Duration::ZERO, Duration::ZERO)
        );
        times.record(0);
        times.record(u64::MAX);
        assert_eq!(times.max(), Duration::from_nanos(u64::MAX));
        assert_eq!(times.min(), Duration::ZERO);
    }
}
