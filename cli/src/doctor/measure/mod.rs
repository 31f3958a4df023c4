//! The measurements: each for a bounded time, under SCHED_FIFO where that is allowed.

mod across;
mod busy;
mod costs;
mod lock;
mod threads;
mod wake_up;

use super::finding::{Finding, Part, Seen, Times};
use super::machine::Machine;
use luna_machine::facts::parse::{core_list, write_core_list};
use luna_machine::latency::DmaLatency;
use luna_machine::memory;
use std::time::Duration;

/// What a measurement gives: times in nanoseconds, unsorted, and the policy under which they were
/// taken.
#[derive(Debug)]
pub(crate) struct Measured {
    times: Vec<u64>,
    /// Where, and how: `fifo:80, core 1`.
    how: String,
}

/// From which on a measurement is what.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    /// A good one is at most this, in nanoseconds.
    good: u64,
    /// A bad one is more than this.
    bad: u64,
    /// The figure that is compared with them.
    by: fn(&Times) -> u64,
}

/// For the wake-up of a sleeping thread, and for the wait for a contended lock, which takes the
/// holder's section, a boost of its priority and the way through the kernel: a twentieth of the
/// period of a fast control loop, and the period, after which a slot is missed.
const WAKE_UP: Bounds = Bounds {
    good: 50_000,
    bad: 1_000_000,
    by: p99,
};

/// The `from` of a finding without times.
const MEASUREMENT: &str = "the measurement";
const AGAIN: &str = "run `luna doctor` again on an idle machine, without --quick";

/// Latencies are judged by their 99th percentile.
fn p99(times: &Times) -> u64 {
    times.p99
}

/// Costs are given by their median, since the measuring thread is interrupted too.
fn p50(times: &Times) -> u64 {
    times.p50
}

/// A finding to be.
struct Measurement {
    name: String,
    why: &'static str,
    advice: &'static str,
    bounds: Bounds,
}

/// Measures all, in about five times `each`.
pub(crate) fn all(machine: &Machine, each: Duration) -> Vec<Finding> {
    // As a system does while it runs; that they can be had is a finding of its own.
    let _latency = DmaLatency::hold();
    let _memory = memory::lock_memory();

    let cores = cores(machine);
    let mut findings = wake_up::on_each(&cores, each);
    findings.extend(across::between(&cores, each));
    findings.push(lock::under_contention(&cores, each));
    // Before the measurements that are busy for longer, which use up the share of real-time
    // threads.
    findings.extend(busy::on(machine));
    findings.push(costs::clock_read(each));
    findings.push(costs::system_call(each));
    findings
}

/// The cores that this process may use, and the one that it is to use, which may be an isolated
/// one.
fn cores(machine: &Machine) -> Vec<usize> {
    let mut cores = luna_platform::thread::available_cores();
    let isolated = machine
        .source
        .parse("/sys/devices/system/cpu/isolated", core_list);
    cores.extend(isolated.unwrap_or_default());
    cores.push(machine.core);
    cores.sort_unstable();
    cores.dedup();
    cores
}

impl Measurement {
    /// Judges what was measured, or gives the reason why nothing was.
    fn finding(self, outcome: Result<Measured, String>) -> Finding {
        let unknown = |why: &str, how| (Seen::unknown(why, how, AGAIN), None);
        let (seen, ns) = match outcome.map(|Measured { times, how }| (times_of(times), how)) {
            Ok((Some(times), how)) => {
                let read = times.text();
                let seen = match (self.bounds.by)(&times) {
                    ns if ns <= self.bounds.good => Seen::good(read, how),
                    ns if ns <= self.bounds.bad => Seen::better(read, how, self.advice),
                    _ => Seen::bad(read, how, self.advice),
                };
                (seen, Some(times))
            }
            Ok((None, how)) => unknown("nothing was measured in the time that there was", how),
            Err(why) => unknown(&why, MEASUREMENT.to_owned()),
        };
        let finding = seen.finding(self.name, Part::Measurement, self.why);
        Finding { ns, ..finding }
    }
}

/// The finding on cores that were not measured, if there are any.
fn left_out(name: &str, why: &'static str, cores: &[usize]) -> Option<Finding> {
    let last = cores.last()?;
    let read = format!("the time was up before {}", write_core_list(cores));
    let advice = format!(
        "run it on fewer cores (`taskset -c {last} luna doctor`), or `luna jitter --core {last}`"
    );
    let seen = Seen::unknown(read, MEASUREMENT, advice);
    Some(seen.finding(name, Part::Measurement, why))
}

fn times_of(mut times: Vec<u64>) -> Option<Times> {
    times.sort_unstable();
    let max = *times.last()?;
    let at = |percent: usize| {
        let rank = (times.len() * percent).div_ceil(100).max(1) - 1;
        times.get(rank).copied().unwrap_or(max)
    };
    Some(Times {
        samples: times.len(),
        min: at(0),
        p50: at(50),
        p99: at(99),
        max,
    })
}

impl Times {
    fn text(&self) -> String {
        let us = |ns: u64| ns as f64 / 1000.0;
        // The cheap ones are tens of nanoseconds.
        let digits = if self.p50 < 1000 { 3 } else { 1 };
        format!(
            "p50 {:.digits$} p99 {:.digits$} max {:.digits$} us, of {}",
            us(self.p50),
            us(self.p99),
            us(self.max),
            self.samples
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::finding::Verdict;

    fn judged(times: Vec<u64>) -> Finding {
        let measurement = Measurement {
            name: "x".to_owned(),
            why: "y",
            advice: "z",
            bounds: WAKE_UP,
        };
        measurement.finding(Ok(Measured {
            times,
            how: "here".to_owned(),
        }))
    }

    #[test]
    fn percentiles_are_of_the_sorted_times() {
        let times = times_of((1..=200).rev().collect()).unwrap();
        assert_eq!(
            (times.min, times.p50, times.p99, times.max, times.samples),
            (1, 100, 198, 200, 200)
        );
        let one = times_of(vec![7]).unwrap();
        assert_eq!((one.min, one.p50, one.p99, one.max), (7, 7, 7, 7));
        assert_eq!(times_of(Vec::new()), None);
    }

    #[test]
    fn what_was_left_out_is_told() {
        assert_eq!(left_out("x", "y", &[]), None);
        let finding = left_out("x", "y", &[5, 6, 9]).unwrap();
        assert_eq!(finding.verdict, Verdict::Unknown);
        assert!(finding.read.contains("5-6,9"), "{finding:?}");
    }

    #[test]
    fn the_99th_percentile_decides() {
        for (p99, verdict) in [
            (50_000, Verdict::Good),
            (50_001, Verdict::CouldBeBetter),
            (1_000_000, Verdict::CouldBeBetter),
            (1_000_001, Verdict::Bad),
        ] {
            // One in a hundred may be anything.
            let times = [vec![p99; 99], vec![u64::MAX]].concat();
            let found = judged(times);
            assert_eq!(found.verdict, verdict, "{p99}");
            assert_eq!(found.advice.is_some(), verdict != Verdict::Good);
        }
        assert_eq!(judged(Vec::new()).verdict, Verdict::Unknown);
        assert_eq!(
            judged(vec![1234; 3]).read,
            "p50 1.2 p99 1.2 max 1.2 us, of 3"
        );
    }
}
