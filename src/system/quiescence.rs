//! Looks whether a system has come to a standstill: the supervising thread's part of the deadlock
//! report.
//!
//! That thread sleeps. A thread of the system that it watches rings it when that one falls still,
//! and only then it looks, at most so often. In a system with a periodic loop no thread stays still
//! for good; there it looks a few times after the start and no more.

use super::deadlock::{Sleeping, find};
use super::plan::{Plan, Running};
use luna_channels::inspect::wait_points;
use luna_core::current::ProcessId;
use luna_core::{ProcessState, Quiescent};
use luna_error::Deadlock;
use luna_platform::clock::Instant;
use std::collections::{HashMap, HashSet};
use std::time::Duration;

/// The time between two looks that find nothing, at first and at most: threads that wake each other
/// cause rings without a deadlock.
const SHORTEST_PAUSE: Duration = Duration::from_micros(200);
const LONGEST_PAUSE: Duration = Duration::from_millis(100);

/// When to look again, and the last finding.
pub(super) struct Lookout {
    pause: Duration,
    not_before: Instant,
    found: Option<Found>,
    /// The deadlock that was reported last.
    reported: Option<Deadlock>,
}

/// A deadlock, and how often processes had been polled when it was found. After one more poll it is
/// no deadlock any more.
struct Found {
    deadlock: Deadlock,
    polls: u64,
}

impl Lookout {
    pub(super) fn new() -> Self {
        Self {
            pause: SHORTEST_PAUSE,
            not_before: Instant::now(),
            found: None,
            reported: None,
        }
    }

    /// Looks, if it is time to. Returns a deadlock if it was found just now and is not the one that
    /// was reported last, and until when to sleep if no ring comes before. After a deadlock was
    /// found it looks again only when the system has gone on, as when a thread outside has used a
    /// channel after all.
    pub(super) fn look(&mut self, plan: &Plan, running: &Running) -> (Option<&Deadlock>, Instant) {
        let is_replayed = running.common.replay_logs.is_replay();
        let still_stands = || self.found.as_ref().is_some_and(|found| found.stands(plan));
        if is_replayed || running.common.emergency.has_begun() || still_stands() {
            return (None, Instant::NEVER);
        }
        self.found = None;
        let now = Instant::now();
        if now < self.not_before {
            return (None, self.not_before);
        }
        // If the last ring is long ago, the next one is not urgent.
        self.pause = if now >= self.not_before + LONGEST_PAUSE {
            SHORTEST_PAUSE
        } else {
            (self.pause * 2).min(LONGEST_PAUSE)
        };
        self.not_before = now + self.pause;
        let quiescent = running.common.registry.quiescent();
        let Some(found) = quiescent.and_then(|quiescent| judge(plan, running, &quiescent)) else {
            return (None, Instant::NEVER);
        };
        let is_new = self.reported.as_ref() != Some(&found.deadlock);
        self.reported = Some(found.deadlock.clone());
        self.found = Some(found);
        (self.reported.as_ref().filter(|_| is_new), Instant::NEVER)
    }

    /// The deadlock at the system's end: none if it has gone on since. One that has ended the
    /// system counts, even if processes ran on the way to safety.
    pub(super) fn into_found(self, plan: &Plan, running: &Running) -> Option<Deadlock> {
        let has_ended_it = running.ends_at_deadlock();
        let found = self
            .found
            .filter(|found| has_ended_it || found.stands(plan));
        found.map(|found| found.deadlock)
    }
}

impl Found {
    fn stands(&self, plan: &Plan) -> bool {
        polls(plan) == self.polls
    }
}

/// How often the processes of the system were polled, those that have ended too. A cancelled
/// process is not polled any more.
fn polls(plan: &Plan) -> u64 {
    let started = &plan.members().started;
    let each = started.in_order().into_iter();
    let of_each: u64 = each.map(|(_, member)| member.handle.polls()).sum();
    of_each + started.earlier().polls
}

/// What the processes wait for, if all threads slept at one instant; `None` if something can wake
/// one, or just has.
fn judge(plan: &Plan, running: &Running, quiescent: &Quiescent) -> Option<Found> {
    let registry = &running.common.registry;
    // From that instant on nothing inside can wake a process. What is read now was so then, unless
    // something outside interferes.
    let processes = sleeping(plan);
    let is_forgotten = |id| plan.members().started.has_forgotten(id);
    let found = processes.and_then(|processes| {
        let points = wait_points();
        let find = |refers: &dyn Fn(ProcessId, usize) -> bool| {
            find(plan.name(), &processes, &points, is_forgotten, refers)
        };
        // Bodies are read only if there is something to explain.
        find(&|_, _| false)?;
        let words = words_of_bodies(plan);
        let deadlock = find(&|id, address| {
            let words = words.get(&id);
            words.is_some_and(|words| words.contains(&address))
        })?;
        let polls = polls(plan);
        Some(Found { deadlock, polls })
    });
    // A wake may come from outside; its effect is to be looked at again.
    registry.watch();
    if registry.is_yet(quiescent) {
        return found;
    }
    registry.announce();
    None
}

/// The machine words in the bodies of the processes that live.
fn words_of_bodies(plan: &Plan) -> HashMap<ProcessId, HashSet<usize>> {
    let members = plan.members();
    let all = members.started.in_order().into_iter();
    let live = all.filter(|(_, member)| !member.is_reaped);
    live.map(|(id, member)| (id, member.words().into_iter().collect()))
        .collect()
}

/// The processes; `None` if one of them is not asleep, as when a thread outside has just spawned
/// it; or has ended and is not reaped, since what it held is yet to be dropped.
fn sleeping(plan: &Plan) -> Option<Vec<Sleeping>> {
    let members = plan.members();
    let started = members.started.in_order().into_iter().map(|(id, member)| {
        let has_ended = match member.handle.state() {
            ProcessState::Ended if member.is_reaped => true,
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
