//! The watcher: a worker that leaves the runner behind if its function takes too long.

use super::{FunctionOutcome, Functions, LIMIT, Slot, Task};
use luna_core::failover::Turn;
use luna_platform::clock::Instant;
use std::time::Duration;

/// How often, at most, a watching worker checks whether a function with a shorter limit has begun
/// meanwhile.
const SHORTEST_LOOK: Duration = Duration::from_millis(1);

impl Functions {
    pub(super) fn watch(&self, turn: Turn, has_crashed: bool) -> Task {
        let now = Instant::now_real();
        let mut slots = self.slots.lock();
        let shortest = shortest(&slots[turn.job()..]);
        let slot = &mut slots[turn.job()];
        // Also if the worker is between its turn and the function's begin.
        let until = slot.running.unwrap_or(now) + slot.limit;
        if now < until && !has_crashed {
            return Task::Until(until.min(now + shortest));
        }
        if !self.failover.leave_behind(turn) {
            // It has just ended.
            return Task::Until(now);
        }
        slot.outcome = FunctionOutcome::LeftBehind;
        slot.took = slot.running.take().map(|began| now - began);
        Task::LeftBehind(turn.member())
    }
}

/// The latest instant at which a worker is to check whether one of these takes too long.
pub(super) fn shortest(slots: &[Slot]) -> Duration {
    let shortest = slots.iter().map(|slot| slot.limit).min();
    shortest.unwrap_or(LIMIT).max(SHORTEST_LOOK)
}
