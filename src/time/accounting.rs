//! What the kernel counted of a thread between two readings.

use luna_platform::clock::Instant;
use luna_platform::usage::ThreadUsage;
use std::fmt;
use std::time::Duration;

/// What the kernel counted of a process' thread in a stretch of time. On an executor it is that of all its processes.
///
/// Part of [`LateCycle`](crate::LateCycle) and [`BudgetOverrun`](crate::BudgetOverrun); an example is in the guide.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct UsageSince {
    /// From here: the reading before. Only where each cycle or poll is accounted for is it the begin of what went wrong; else it is the last time that
    /// something did, or the start. Counters that stand still over a long time are as good an answer: nothing of it was the cause.
    pub since: Instant,
    /// Until here.
    pub until: Instant,
    /// What was counted.
    pub counted: ThreadUsage,
}

impl UsageSince {
    /// How long it was.
    pub fn elapsed(&self) -> Duration {
        self.until - self.since
    }
}

impl fmt::Display for UsageSince {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let counted = &self.counted;
        write!(
            f,
            "in the {} before: {} on the processor, ",
            short(self.elapsed()),
            short(counted.cpu_time),
        )?;
        if let Some(delay) = counted.run_delay {
            write!(f, "{} in the queue for it, ", short(delay))?;
        }
        write!(
            f,
            "{}, {}, {}",
            counts(counted.involuntary_switches, "involuntary switch", "es"),
            counts(counted.minor_faults, "minor page fault", "s"),
            counts(counted.major_faults, "major one", "s"),
        )
    }
}

fn counts(number: u64, what: &str, plural: &str) -> String {
    match number {
        0 => format!("no {what}"),
        1 => format!("1 {what}"),
        _ => format!("{number} {what}{plural}"),
    }
}

/// A duration in three digits or so, for people.
pub(crate) fn short(duration: Duration) -> String {
    let nanos = duration.as_nanos() as f64;
    match nanos {
        ..1e3 => format!("{nanos} ns"),
        1e3..1e6 => format!("{:.1} us", nanos / 1e3),
        1e6..1e9 => format!("{:.2} ms", nanos / 1e6),
        _ => format!("{:.2} s", nanos / 1e9),
    }
}

/// The last reading. Belongs to one thread.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Accounting(Option<(Instant, ThreadUsage)>);

impl Accounting {
    /// Reads, and begins anew. Three system calls.
    pub(crate) fn begin(&mut self, now: Instant) {
        self.0 = ThreadUsage::of_current_thread().map(|usage| (now, usage));
    }

    /// Reads, gives what was counted since the reading before, and begins anew. Three system calls.
    pub(crate) fn turn(&mut self, now: Instant) -> Option<UsageSince> {
        let before = self.0;
        self.begin(now);
        let ((since, earlier), (until, usage)) = (before?, self.0?);
        Some(UsageSince {
            since,
            until,
            counted: usage.since(&earlier),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_short() {
        for (nanos, text) in [
            (999, "999 ns"),
            (1_500, "1.5 us"),
            (3_210_000, "3.21 ms"),
            (2_000_000_000, "2.00 s"),
        ] {
            assert_eq!(short(Duration::from_nanos(nanos)), text);
        }
    }

    #[test]
    fn nothing_is_known_before_the_second_reading() {
        let mut accounting = Accounting::default();
        assert_eq!(accounting.turn(Instant::from_nanos(1)), None);
        if let Some(usage) = accounting.turn(Instant::from_nanos(5)) {
            assert_eq!(usage.elapsed(), Duration::from_nanos(4));
        }
    }
}
