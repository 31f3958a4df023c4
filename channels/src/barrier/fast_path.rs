//! A barrier among processes of one executor: arriving and releasing without atomics.
//!
//! It gives the same results as [`SyncOp::look`](super::SyncOp::look) and [`Meeting::release`],
//! without branches for what is not there: the lock is biased to the executor, the turn is a plain
//! one, and no alternative offers the barrier. So no waker is cloned or called, and no user code
//! runs. A party is woken under the lock, by stores to this thread's run queue. If one of these
//! conditions does not hold as a party comes, no state has changed, and the party takes the slow
//! path. If one ceases to hold between two sections of a release, the slow path releases the rest.
//!
//! A node that was listed here is marked so ([`Waiter::begin_plain`]). A party that finds it here
//! knows that its process belongs to this very executor: only the executor that owns the bias comes
//! here, and a lock is biased to no second one.

use super::{Barrier, Meeting};
use crate::waiter::Waiter;
use core::ptr::NonNull;
use luna_core::biased_lock::Refused;
use luna_core::current::PlainTurn;

/// The most parties that are released in one critical section.
const TOGETHER: usize = 16;

/// What coming to the barrier has led to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Arrival {
    /// Fast path unavailable; no state changed. Take the slow path.
    SlowPath,
    /// The node is listed.
    Waits,
    /// The round is complete, and the others are released.
    Done,
    /// As `Done`, and the process is queued again: others run first.
    GaveWay,
    /// The round is complete, and there are others to be [released](Meeting::release).
    Completes,
}

impl Barrier {
    /// Comes to the barrier. Without atomic read-modify-writes; O(waiting parties of lower
    /// priority), and O(parties) for the last one.
    ///
    /// # Safety
    ///
    /// `node` is a party's that is not listed. No other thread accesses it, and it stays where it
    /// is until it is settled or taken back.
    #[inline(never)]
    pub(super) unsafe fn come_fast(
        &self,
        node: NonNull<Waiter<()>>,
        turn: PlainTurn<'_>,
    ) -> Arrival {
        let meeting: &Meeting = &self.meeting;
        // SAFETY: no user code runs under this lock, so nothing polls while this thread holds it.
        let mut lists = match unsafe { meeting.enter(turn) } {
            Ok(lists) => lists,
            Err(Refused::NotBiased) => return Arrival::SlowPath,
            Err(Refused::Revoked) => return meeting.revoked(Arrival::SlowPath),
        };
        let waits_for = meeting.state(&mut lists, |round, _| {
            if round.offering > 0 || round.arrived + 1 >= round.parties {
                return None;
            }
            round.arrived += 1;
            Some(round.number)
        });
        let Some(number) = waits_for else {
            lists.keep();
            // SAFETY: the lock was kept.
            return unsafe { meeting.complete_plain(turn) };
        };
        // SAFETY: the lists are this barrier's, and the lock is held. The node is in none of them,
        // and stays where it is.
        unsafe {
            Waiter::begin_plain(node, turn);
            (*Waiter::link(node)).ticket = number;
            lists.senders.insert_again(node.cast());
        }
        match lists.leave() {
            true => Arrival::Waits,
            false => meeting.revoked(Arrival::Waits),
        }
    }
}

impl Meeting {
    /// Completes the round, unless an alternative offers the barrier, and releases members of
    /// completed rounds as long as they were listed here and live. A function of its own, so that
    /// no register is saved for it where the party waits.
    ///
    /// # Safety
    ///
    /// The lock was kept, by the party that comes last.
    #[inline(never)]
    unsafe fn complete_plain(&self, turn: PlainTurn<'_>) -> Arrival {
        // SAFETY: the lock was kept, and is taken back once.
        let mut lists = unsafe { self.kept(turn) };
        let is_plain = self.state(&mut lists, |round, _| round.offering == 0);
        if !is_plain || !self.complete_with(&mut lists, 1) {
            return Arrival::SlowPath;
        }
        loop {
            let mut left = TOGETHER;
            // SAFETY: the lock is held, and biased to this thread's executor. A listed node is a
            // live waiter, and is not touched after it was settled.
            unsafe {
                while left > 0
                    && let Some(first) = lists.held.first()
                    && Waiter::wake_plain(first.cast::<Waiter<()>>())
                {
                    lists.held.remove_first(first);
                    Waiter::settle_plain(first.cast::<Waiter<()>>());
                    left -= 1;
                }
            }
            let is_last = lists.held.is_empty();
            drop(lists);
            if is_last {
                return match turn.yields_after_operation() {
                    true => Arrival::GaveWay,
                    false => Arrival::Done,
                };
            }
            // SAFETY: the lock was released just now.
            lists = match unsafe { self.try_enter(turn) } {
                Some(again) if left == 0 => again,
                _ => return Arrival::Completes,
            };
        }
    }
}
