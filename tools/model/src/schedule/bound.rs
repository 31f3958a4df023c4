//! The bound of a job's response.

use super::around::{Gap, around, demands};
use super::{Arrivals, Demand, Task, Thread, nanos};
use response_time_analysis::arrival::ArrivalBound;
use response_time_analysis::demand::{RBF, RequestBound, step_offsets};
use response_time_analysis::fixed_point::{SearchResult, search};
use response_time_analysis::supply::Dedicated;
use response_time_analysis::time::{self, Offset, Service};
use response_time_analysis::wcet::Scalar;
use std::cell::Cell;
use std::time::Duration;

/// Why a task has no bound.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NoBound {
    /// Its thread has no real-time policy: the kernel shares the core as it finds fair.
    #[error("its thread has no real-time policy: give it one")]
    Ordinary,
    /// Those that run before it and itself ask for more time than there is.
    #[error(
        "it and what runs before it ask for {:.1} % of the core: lower costs, longer periods, or \
         another core",
        utilization * 100.0
    )]
    Overload {
        /// The share of the core's time that they ask for in the long run.
        utilization: f64,
    },
    /// Those that run before it and itself may be busy without a pause for longer than was looked
    /// at.
    #[error(
        "its core may be busy for more than {limit:?} without a pause, which is as far as is \
         looked: lower costs, or another core"
    )]
    TooLong {
        /// So far was looked.
        limit: Duration,
    },
    /// Something that it needs is not known.
    #[error("{0}: state it")]
    Unknown(Gap),
}

/// Sums of shares are as exact as this.
const ROUNDING: f64 = 1e-9;

/// Busy times are followed so far.
const LIMIT: Duration = Duration::from_secs(10);

/// A bound is searched for in so many steps.
const MAX_STEPS: usize = 1_000_000;

/// In ns, more than any limit.
const BEYOND: u64 = 1_000_000_000_000_000_000;

/// For each task the time from when a job ought to be released to its end, at most.
///
/// Not real-time. The bound holds if no job takes longer than its task's `cost`, no poll longer
/// than `longest_poll`, no release is closer than `arrivals` says, a job does not wait for anything
/// but the core, and nothing of a rank above 0 runs on its core but what is in the set.
///
/// # Panics
///
/// The thread of a task is not in `threads`.
#[must_use]
pub fn bounds(threads: &[Thread], tasks: &[Task]) -> Vec<Result<Duration, NoBound>> {
    (0..tasks.len())
        .map(|number| bound(threads, tasks, number))
        .collect()
}

/// What delays a job.
struct Delays<'a> {
    own: Requests<'a>,
    /// One poll of a task of lower priority, which has begun just before.
    blocking: Service,
    beside: Vec<Requests<'a>>,
    above: Vec<Requests<'a>>,
}

type Requests<'a> = RBF<Box<dyn ArrivalBound + 'a>, Scalar>;

fn requests(demand: &Demand) -> Requests<'_> {
    RBF::new(demand.curve(), Scalar::new(nanos(demand.cost).into()))
}

fn sum(all: &[Requests<'_>], delta: time::Duration) -> Service {
    all.iter().map(|one| one.service_needed(delta)).sum()
}

fn bound(threads: &[Thread], tasks: &[Task], number: usize) -> Result<Duration, NoBound> {
    let task = &tasks[number];
    if threads[task.thread].rank == 0 {
        return Err(NoBound::Ordinary);
    }
    let own = demands(tasks, &[number]).map_err(NoBound::Unknown)?[0];
    let around = around(threads, tasks, number).map_err(NoBound::Unknown)?;
    let beside = demands(tasks, &around.beside).map_err(NoBound::Unknown)?;
    let above = demands(tasks, &around.above).map_err(NoBound::Unknown)?;
    let blocking = around.blocking.and_then(|other| tasks[other].longest_poll);
    let all: Vec<&Demand> = beside.iter().chain(&above).chain([&own]).copied().collect();
    let utilization: f64 = all.iter().map(|demand| demand.utilization()).sum();
    if utilization > 1.0 + ROUNDING {
        return Err(NoBound::Overload { utilization });
    }
    // So the sums of times stay far below what their type holds.
    let mut times = all.iter().flat_map(|demand| [demand.cost, demand.jitter()]);
    // The first steps of a task are as many as it may be periods late.
    let is_dense = all.iter().any(|demand| match demand.arrivals {
        Arrivals::Periodic { period, jitter } => {
            jitter.as_nanos() / period.as_nanos().max(1) > MAX_STEPS as u128
        }
        Arrivals::Seen(_) => false,
    });
    if is_dense || times.any(|time| time > LIMIT) || blocking > Some(LIMIT) {
        return Err(NoBound::TooLong { limit: LIMIT });
    }
    let delays = Delays {
        own: requests(own),
        blocking: blocking.map_or(0, nanos).into(),
        beside: beside.into_iter().map(requests).collect(),
        above: above.into_iter().map(requests).collect(),
    };
    let last_poll = if task.is_one_poll {
        nanos(own.cost).max(1)
    } else {
        1
    };
    let found = delays.response(last_poll);
    let found = found.map_err(|_| NoBound::TooLong { limit: LIMIT })?;
    Ok(Duration::from_nanos(found.into()) + own.jitter())
}

impl Delays<'_> {
    /// From the release to the end, with a last poll of this length.
    fn response(&self, last_poll: u64) -> SearchResult {
        let processor = Dedicated::new();
        let limit = nanos(LIMIT).into();
        // After too many steps it asks for more time than any limit.
        let steps = Cell::new(0);
        let above = |length| {
            steps.set(steps.get() + 1);
            let too_many = if steps.get() > MAX_STEPS { BEYOND } else { 0 };
            sum(&self.above, length) + too_many.into()
        };
        let busy = search(&processor, limit, |length| {
            self.blocking
                + sum(&self.beside, length)
                + above(length)
                + self.own.service_needed(length)
        })?;
        // What is left when only threads above can still delay it.
        let rest = Service::from(last_poll - 1);
        let of = |offset: Offset| {
            let jobs = self.own.service_needed(offset.closed_since_time_zero());
            let begun = search(&processor, limit, |length| {
                self.blocking + (jobs - rest) + sum(&self.beside, length) + above(length)
            })?;
            let beside = sum(&self.beside, begun);
            let ended = search(&processor, limit, |length| {
                self.blocking + jobs + beside + above(length)
            })?;
            Ok(ended - offset.since_time_zero())
        };
        let within = |offset: &Offset| *offset < Offset::from_time_zero(busy);
        // The first failure ends it: `max_response_time` would go on.
        let mut all = step_offsets(&self.own).take_while(within).map(of);
        let zero = time::Duration::from(0);
        all.try_fold(zero, |longest, found| Ok(longest.max(found?)))
    }
}
