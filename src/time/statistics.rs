//! What is counted of a periodic loop.

use super::distribution::Distribution;
use super::late::{LateCycles, Witness};
use super::late_cycle::LateCycle;
use super::registry::LoopName;
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
}
