//! When each cycle is over at the latest.
//!
//! # What runs
//!
//! A set has *threads* on cores and *tasks* on threads. A thread is an executor or an OS-thread
//! process. Of the threads of a core the one of the highest rank runs; it takes the core from
//! others at any instant. Threads of one rank take turns when they sleep, or in slices.
//!
//! A task is a process. It releases jobs: the cycles of a loop, or the turns of a process that
//! others wake. A job is a sequence of polls, with no wait between them. An executor begins a poll
//! of the most urgent task that is ready, and looks again when the poll is over; it is preempted in
//! the middle of a poll by threads of higher rank alone. Tasks of one priority take turns after
//! each poll. The next job of a task begins when the one before it has ended.
//!
//! # The bound
//!
//! It is that of limited-preemptive fixed priorities ([Bozhko and Brandenburg, ECRTS
//! 2020](https://drops.dagstuhl.de/opus/volltexte/2020/12385/pdf/LIPIcs-ECRTS-2020-22.pdf)). Let
//! the *rivals* of a task be the tasks of threads of higher rank on its core, and the tasks of its
//! thread that are as urgent or more. Look at the core from an instant before which all jobs of the
//! task and of its rivals have ended, until the next such instant. A task of lower priority begins
//! a poll only at an instant of this kind, so one such poll at most delays what comes after it.
//! Apart from it the core serves only the task's own jobs, in their order, and those of its rivals.
//!
//! Rivals on the same thread delay a job only until its last poll begins. Those of higher rank do
//! until its end, which that analysis does not have: so the end of the last poll is searched for
//! separately, as for tasks with preemption thresholds. If another thread of the core has the same
//! rank, all tasks of both threads are rivals until the job's end, whatever their priority.

mod around;
mod bound;
mod costs;
#[cfg(test)]
mod models;
mod placed;
mod plan;
mod seen;
#[cfg(test)]
mod simulated;
#[cfg(test)]
mod tests;
mod verdict;

pub use around::Gap;
pub use bound::{NoBound, bounds};
pub use costs::{Costs, Known};
pub use plan::{Core, Row, Schedule};
pub use seen::{Releases, Seen};
pub use verdict::Verdict;

pub(crate) use costs::read as read_costs;
pub(crate) use plan::schedule;

use response_time_analysis::arrival::{ArrivalBound, Sporadic};
use std::time::Duration;

/// A thread that runs tasks: an executor, or an OS-thread process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Thread {
    /// The core that it is pinned to. Threads of different cores do not delay each other.
    pub core: usize,
    /// Its real-time priority, 1 to 99; 0 for an ordinary thread, which has no bound.
    pub rank: u8,
}

/// What releases jobs on a thread.
#[derive(Debug, Clone)]
pub struct Task {
    /// Its thread's place in the set.
    pub thread: usize,
    /// Its priority on this thread. The greater is the more urgent.
    pub priority: u8,
    /// When jobs are released, and how long they take; none if that is not known.
    pub demand: Option<Demand>,
    /// The longest poll of a job; none if it is not known.
    pub longest_poll: Option<Duration>,
    /// Whether each job is one poll. Else nothing is assumed of how long its last one takes.
    pub is_one_poll: bool,
}

/// What a task asks for.
#[derive(Debug, Clone)]
pub struct Demand {
    /// When jobs are released.
    pub arrivals: Arrivals,
    /// The longest execution time of a job.
    pub cost: Duration,
}

/// When jobs are released.
#[derive(Debug, Clone)]
pub enum Arrivals {
    /// One in each period, and each at most `jitter` late.
    Periodic {
        /// From one to the next; not zero.
        period: Duration,
        /// What a release may be late by: the latency of the timer.
        jitter: Duration,
    },
    /// As they were seen.
    Seen(Seen),
}

/// In ns; longer ones count as this.
const LONGEST_PERIOD: u64 = 1_000_000_000_000_000_000;

impl Demand {
    fn curve(&self) -> Box<dyn ArrivalBound + '_> {
        match &self.arrivals {
            Arrivals::Periodic { period, jitter } => Box::new(Sporadic::new(
                // The crate multiplies it.
                nanos(*period).clamp(1, LONGEST_PERIOD).into(),
                nanos(*jitter).into(),
            )),
            Arrivals::Seen(Seen(curve)) => Box::new(curve),
        }
    }

    /// How late a job may be released.
    fn jitter(&self) -> Duration {
        match self.arrivals {
            Arrivals::Periodic { jitter, .. } => jitter,
            Arrivals::Seen(_) => Duration::ZERO,
        }
    }

    /// The share of its core's time that it takes at most, in the long run.
    #[must_use]
    pub fn utilization(&self) -> f64 {
        const LONG: u64 = 3_600_000_000_000;
        let rate = match &self.arrivals {
            Arrivals::Periodic { period, .. } => 1.0 / nanos(*period).max(1) as f64,
            Arrivals::Seen(seen) => seen.count(LONG) as f64 / LONG as f64,
        };
        nanos(self.cost) as f64 * rate
    }
}

fn nanos(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}
