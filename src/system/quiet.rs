//! Looks whether a system has come to a standstill: the supervising thread's part of the deadlock report.
//!
//! That thread sleeps. A thread of the system that it watches rings it when that one falls still, and only then it looks, at most so often;
//! in a system with a periodic loop, none of whose threads ever stays still, it looks a few times after the start and no more.

use super::deadlock::{Deadlock, Sleeping, find};
use super::plan::{Plan, Running};
use crate::csp::network;
use luna_executors::{ProcessState, Stillness};
use luna_platform::clock::Instant;
use std::time::Duration;

/// The time between two looks that find nothing, at first and at most: a system whose threads wake each other rings for nothing.
const SHORTEST_PAUSE: Duration = Duration::from_micros(200);
const LONGEST_PAUSE: Duration = Duration::from_millis(100);

/// When to look again, and what was found.
pub(super) struct Lookout {
    pause: Duration,
    not_before: Instant,
    found: Option<Deadlock>,
}

impl Lookout {
    pub(super) fn new() -> Self {
        Self {
            pause: SHORTEST_PAUSE,
            not_before: Instant::now(),
            found: None,
        }
    }

    /// Looks, if it is time to, until a deadlock was found once. Gives the deadlock if it was found just now, and until when to sleep if
    /// nobody rings before.
    pub(super) fn look(&mut self, plan: &Plan, running: &Running) -> (Option<&Deadlock>, Instant) {
        let is_replayed = running.common.tapes.is_replay();
        if self.found.is_some() || is_replayed || running.common.emergency.has_begun() {
            return (None, Instant::NEVER);
        }
        let now = Instant::now();
        if now < self.not_before {
            return (None, self.not_before);
        }
        // Who was not rung for long is in no hurry to ring again.
        self.pause = if now >= self.not_before + LONGEST_PAUSE {
            SHORTEST_PAUSE
        } else {
            (self.pause * 2).min(LONGEST_PAUSE)
        };
        self.not_before = now + self.pause;
        if let Some(stillness) = running.common.living.still() {
            self.found = judge(plan, running, &stillness);
        }
        (self.found.as_ref(), Instant::NEVER)
    }

    pub(super) fn into_found(self) -> Option<Deadlock> {
        self.found
    }
}

/// What the processes wait for, all of whose threads slept at one instant; `None` if somebody can wake one, or just has.
fn judge(plan: &Plan, running: &Running, stillness: &Stillness) -> Option<Deadlock> {
    let living = &running.common.living;
    // Nobody inside can wake anybody from that instant on. What is read now was so then, unless somebody outside interferes.
    let processes = sleeping(plan);
    let is_forgotten = |id| plan.members().started.has_forgotten(id);
    let found = processes
        .and_then(|processes| find(plan.name(), &processes, &network::meetings(), is_forgotten));
    if found.is_none() {
        // Somebody may come from outside; what becomes of it is to be looked at again.
        living.watch();
    }
    if living.is_yet(stillness) {
        return found;
    }
    living.announce();
    None
}

/// The processes; `None` if one of them is not asleep, as when somebody outside has just spawned it; or has ended and is not buried, since what it held is yet to be dropped.
fn sleeping(plan: &Plan) -> Option<Vec<Sleeping>> {
    let members = plan.members();
    let started = members.started.in_order().into_iter().map(|(id, member)| {
        let has_ended = match member.handle.state() {
            ProcessState::Ended if member.buried => true,
            ProcessState::Waiting => false,
            _ => return None,
        };
        Some(Sleeping {
            id,
            name: std::sync::Arc::from(member.name()),
            has_ended,
            joiners: member.handle.joiners(),
        })
    });
    started.collect()
}
