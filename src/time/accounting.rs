//! What the kernel counted of a thread between two readings.

use luna_machine::usage::ThreadUsage;
use luna_platform::clock::Instant;
use std::fmt;
use std::time::Duration;

/// What the kernel counted of a process' thread in a stretch of time. On an executor it is that of
/// all its processes.
///
/// Part of [`LateCycle`](crate::report::LateCycle) and
/// `BudgetOverrun`; `docs/budgets.md` has an example.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct UsageSince {
    /// From here: the reading before. It is the begin of the cycle or poll before where each is
    /// accounted for; else it is the last time that something went wrong, or the start. What was
    /// counted in a long window need not have to do with what went wrong at its end; counters that
    /// stood still show that none of it was the cause.
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

    /// How long the thread waited in the queue for a core from `begin` until the end of the
    /// window, at least: all that does not fit before `begin`. `None` where the kernel does not
    /// count it.
    pub(crate) fn queued_since(&self, begin: Instant) -> Option<Duration> {
        let before = begin.min(self.until) - self.since;
        Some(self.counted.run_delay?.saturating_sub(before))
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
        1e3..1e6 => format!("{:.1} µs", nanos / 1e3),
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
            (1_500, "1.5 µs"),
            (3_210_000, "3.21 ms"),
            (2_000_000_000, "2.00 s"),
        ] {
            assert_eq!(short(Duration::from_nanos(nanos)), text);
        }
    }

    #[test]
    fn of_a_long_window_only_what_fits_nowhere_else_counts() {
        let usage = |run_delay| {
            let mut counted = ThreadUsage::default();
            counted.run_delay = run_delay;
            UsageSince {
                since: Instant::from_nanos(1_000),
                until: Instant::from_nanos(2_000),
                counted,
            }
        };
        let nanos = |nanos| Some(Duration::from_nanos(nanos));
        for (begin, queued, least) in [(1_900, 900, 0), (1_900, 950, 50), (500, 70, 70)] {
            let begin = Instant::from_nanos(begin);
            assert_eq!(usage(nanos(queued)).queued_since(begin), nanos(least));
        }
        assert_eq!(usage(None).queued_since(Instant::from_nanos(1_500)), None);
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
