//! The threads of a system that runs, and their end: in a bounded time, however it comes.

use super::plan::{NamedThread, Phase, Plan};
use crate::notice::notice;
use crate::report::ThreadReport;
use crate::safety::Cause;
use luna_core::{Executor, Simulation};
use luna_machine::facts::{RealTimeShare, Source};
use luna_machine::shortfall::Shortfall;
use luna_platform::clock::Instant;
use luna_platform::thread::{Obtained, Policy};
use std::collections::VecDeque;
use std::time::Duration;

/// How long the end of a system waits for threads that do not end.
const GRACE: Duration = Duration::from_secs(2);

/// How often a panic's end looks whether a thread has ended.
const LOOKS_EVERY: Duration = Duration::from_millis(1);

/// The threads that run processes. Dropped before the run is over, the thread that runs the system
/// panics.
pub(super) struct SystemThreads<'a> {
    pub(super) plan: &'a Plan,
    /// What runs the executors, if their time is virtual.
    pub(super) simulation: Option<Simulation>,
    pub(super) executors: VecDeque<(String, Executor)>,
    /// The plan has them as long as processes may start.
    pub(super) threads: VecDeque<NamedThread>,
    /// A thread was detached: its body still exists.
    pub(super) has_left_behind: bool,
    /// The run has come to its end.
    pub(super) is_over: bool,
}

impl SystemThreads<'_> {
    /// Requests the end of all threads, waits for them a bounded time, by `wait`, and detaches
    /// those that do not end.
    pub(super) fn end(
        &mut self,
        wait: impl Fn(Instant, &dyn Fn() -> bool) -> bool,
    ) -> Vec<ThreadReport> {
        if let Some(simulation) = &self.simulation {
            simulation.request_stop();
        }
        for (_, executor) in &self.executors {
            executor.request_stop();
        }
        for (_, thread) in &self.threads {
            thread.request_stop();
        }
        let deadline = Instant::now() + GRACE;
        let mut reports = Vec::new();
        // Each stays in its list until it has ended: should `wait` panic, it is still known.
        // `has_left_behind` is set before `abandon`: if anything panics from there on, what the
        // threads' bodies refer to stays.
        macro_rules! end_all {
            ($threads:expr, $stop:expr) => {
                while let Some((name, thread)) = $threads.front() {
                    let ended = wait(deadline, &|| thread.has_stopped());
                    let time = thread.processor_time();
                    reports.push(thread_report(name, thread.obtained(), time, !ended));
                    match $threads.pop_front() {
                        Some((_, thread)) if ended => $stop(thread),
                        Some((_, thread)) => {
                            self.has_left_behind = true;
                            thread.abandon();
                        }
                        None => {}
                    }
                }
            };
        }
        end_all!(self.executors, Executor::stop);
        end_all!(self.threads, drop);
        for report in reports.iter().filter(|report| report.abandoned) {
            notice!(
                "luna: `{}` did not end within {GRACE:?} and is left to itself",
                report.name
            );
        }
        if let Some(simulation) = self.simulation.take()
            && self.has_left_behind
        {
            simulation.abandon();
        }
        reports
    }
}

impl Drop for SystemThreads<'_> {
    fn drop(&mut self) {
        if self.is_over {
            return;
        }
        // Nothing if it has ended already.
        self.plan.emergency.trigger(Cause::Panic);
        {
            let mut members = self.plan.members();
            members.phase = Phase::Ended;
            members.running = None;
            self.threads.extend(std::mem::take(&mut members.threads));
        }
        // While their processes are there: dropped before, a body would use what is gone.
        self.end(|deadline, done| {
            while !done() && Instant::now() < deadline {
                std::thread::sleep(LOOKS_EVERY);
            }
            done()
        });
        if self.has_left_behind {
            // Now, or by an end that came before the panic. Their owners are not looked up any
            // more.
            for left_behind in self.plan.members().started.left_behind() {
                std::mem::forget(left_behind.resident.take());
            }
        }
    }
}

fn thread_report(
    name: &str,
    obtained: Option<&Obtained>,
    processor_time: Option<Duration>,
    abandoned: bool,
) -> ThreadReport {
    ThreadReport {
        name: name.to_owned(),
        policy: obtained.map_or(Policy::Other, |got| got.policy),
        core: obtained.and_then(|got| got.core),
        shortfalls: obtained
            .map(|got| got.refusals.iter().map(Shortfall::of).collect())
            .unwrap_or_default(),
        abandoned,
        processor_time,
        limit: None,
    }
}

/// Notes the kernel's limit with the real-time threads that came to it.
pub(super) fn note_limits(threads: &mut [ThreadReport], source: &Source, elapsed: Duration) {
    for thread in threads {
        let is_limited = matches!(thread.policy, Policy::Fifo(_) | Policy::RoundRobin(_));
        let (true, Some(core), Some(time)) = (is_limited, thread.core, thread.processor_time)
        else {
            continue;
        };
        let limit = RealTimeShare::read(source, core).ok().flatten();
        thread.limit = limit.filter(|limit| limit.is_reached(time, elapsed));
    }
}

#[cfg(test)]
mod tests;
