//! The runner: the worker that runs the next function.

use super::watcher::shortest;
use super::{FunctionOutcome, Functions, Moment};
use luna_core::failover::Turn;
use luna_platform::clock::Instant;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::Ordering;

impl Functions {
    pub(super) fn run(&self, turn: Turn, around: impl Fn(Moment)) -> bool {
        let began = Instant::now_real();
        let (run, shortest) = {
            let mut slots = self.slots.lock();
            let shortest = shortest(&slots[turn.job()..]);
            let slot = &mut slots[turn.job()];
            if slot.run.is_some() {
                (slot.began, slot.running) = (Some(began), Some(began));
            }
            (slot.run.take(), shortest)
        };
        let Some(mut run) = run else {
            // Withdrawn, or it has hung in an earlier round.
            return self.failover.finish(turn);
        };
        let is_first = !self.has_called.load(Ordering::Relaxed);
        around(Moment::Begins(is_first.then(|| began + shortest)));
        // After the clock is read: a worker that sees this flag reads the clock later.
        self.has_called.store(true, Ordering::Release);
        // The others must run whatever this one does.
        let outcome = match catch_unwind(AssertUnwindSafe(&mut run)) {
            Ok(()) => FunctionOutcome::Ran,
            Err(payload) => {
                // Its drop is user code too.
                std::mem::forget(payload);
                FunctionOutcome::Panicked
            }
        };
        around(Moment::Ended);
        let mut slots = self.slots.lock();
        if slots[turn.job()].outcome == FunctionOutcome::LeftBehind {
            // Nothing else refers to the function now. Its drop is user code and runs at low
            // priority.
            drop(slots);
            drop(run);
            return false;
        }
        let slot = &mut slots[turn.job()];
        slot.outcome = outcome;
        slot.took = slot.running.take().map(|began| Instant::now_real() - began);
        slot.run = Some(run);
        // Under the lock, as the watching worker's decision is: one of the two comes first.
        self.failover.finish(turn)
    }
}
