//! Sees to processes that have ended, on the thread that runs the system.

use super::plan::{Plan, Running};
use super::warnings::PendingErrors;
use crate::csp::process::clean_up;
use luna_core::{current, deferred_free};
use luna_platform::clock::Instant;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

/// Runs `post_run` of the processes that have ended, drops them, and frees what they left.
pub(super) struct Reaper<'a> {
    pub(super) plan: &'a Plan,
    pub(super) running: &'a Running,
    /// Where errors go; `None` while processes are being ended, since their errors do not count
    /// then.
    pub(super) errors: Option<&'a PendingErrors>,
}

impl Reaper<'_> {
    /// Whether a process has ended since the last time, or there is another reason to come again
    /// soon. O(their number).
    pub(super) fn reap(&self) -> bool {
        let mut have_ended = false;
        let common = &self.running.common;
        let hurried = common.registry.hurried();
        let clock = common.clock.enter();
        loop {
            // One at a time and without the lock, since `post_run` may take long, and spawn.
            let next = {
                let mut members = self.plan.members();
                members.started.note_ends(common);
                have_ended |= members.started.take_news();
                members.started.next_reaped()
            };
            let Some(reaped) = next else { break };
            let _ = catch_unwind(AssertUnwindSafe(|| drop(reaped.forgotten)));
            if let (Some(error), Some(errors)) = (reaped.error, self.errors) {
                errors.add(&error);
            }
            let panicked = if reaped.ended_for_overrun {
                // What it holds outside of its body is dropped in the same way as the body was.
                current::poison_dropped_ends(|| clean_up(reaped.resident))
            } else {
                clean_up(reaped.resident)
            };
            if let Some(error) = panicked
                && let Some((order, process)) = reaped.of
            {
                let error = error.in_process(&process);
                if let Some(errors) = self.errors {
                    errors.add(&error);
                }
                let started = &mut self.plan.members().started;
                started.first_cleanup.keep(order, &error);
            }
        }
        deferred_free::collect();
        drop(clock);
        if let Some(simulation) = &self.running.simulation {
            simulation.attended(hurried);
        }
        have_ended
    }
}

/// Waits for a thread's end, and reaps the processes that end meanwhile. There is no event for it,
/// and it is not urgent: so it polls at intervals.
pub(super) fn wait_until(reaper: &Reaper<'_>, deadline: Instant, done: &dyn Fn() -> bool) -> bool {
    let mut pause = Duration::from_micros(20);
    while !done() {
        reaper.reap();
        if Instant::now() >= deadline {
            return false;
        }
        std::thread::sleep(pause);
        pause = (pause * 2).min(Duration::from_millis(5));
    }
    true
}
