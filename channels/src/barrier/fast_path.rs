//! A barrier among processes of one executor: arriving and releasing without atomics.
//!
//! It gives the same results as [`SyncOp::look`](super::SyncOp::look) and
//! [`Meeting::release`], without branches for what is not there: the lock is biased to the
//! executor, the turn is a plain one, and no alternative offers the barrier. So no waker is cloned
//! or called, and no user code runs. Whenever one of these conditions does not hold, no state has
//! changed, and the party takes the slow path.
//!
//! A node that was listed here is marked so ([`Waiter::begin_plain`]). A party that finds it here
//! knows that its process belongs to this very executor: only the executor that owns the bias comes
//! here, and a lock is biased to no second one.

use super::{Barrier, Meeting};
use crate::wait_point::WaitQueues;
use crate::waiter::Waiter;
use core::mem::MaybeUninit;
use core::ptr::NonNull;
use luna_core::biased_lock::{InsideGuard, Refused};
use luna_core::current::{PlainPendingWake, PlainTurn};

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
            Err(Refused::Revoked) => return meeting.revoked(),
        };
        // SAFETY: the lists are this barrier's, and the lock is held. The node is in none of them,
        // and stays where it is.
        unsafe {
            let came = meeting.state(&mut lists, |round, _| {
                if round.offering > 0 {
                    return Arrival::SlowPath;
                }
                round.arrived += 1;
                if round.arrived < round.parties {
                    Waiter::begin_plain(node, turn);
                    (*Waiter::link(node)).ticket = round.number;
                    return Arrival::Waits;
                }
                round.arrived = 0;
                round.number = round.number.wrapping_add(1);
                Arrival::Completes
            });
            if came != Arrival::Completes {
                if came == Arrival::Waits {
                    lists.senders.insert_again(node.cast());
                }
                return came;
            }
            let WaitQueues { senders, held, .. } = &mut *lists;
            held.append(senders);
            meeting.release_plain(lists, turn)
        }
    }
}

impl Meeting {
    #[cold]
    fn revoked(&self) -> Arrival {
        self.after_revocation();
        Arrival::SlowPath
    }

    /// Releases members of completed rounds, as long as they were listed here; then the process
    /// that has completed one is done.
    ///
    /// # Safety
    ///
    /// `lists` are this barrier's.
    #[inline]
    unsafe fn release_plain<'a>(
        &'a self,
        mut lists: InsideGuard<'a, WaitQueues>,
        turn: PlainTurn<'_>,
    ) -> Arrival {
        let mut pending = [const { MaybeUninit::<PlainPendingWake>::uninit() }; TOGETHER];
        // In each round the first `count` places are written, and taken once.
        // SAFETY: the lock is held, and biased to this thread's executor: plain wake handles were
        // made here. A listed node is a live waiter, and is not touched after it was settled.
        unsafe {
            loop {
                let mut count = 0;
                while count < TOGETHER
                    && let Some(first) = lists.held.first()
                    && let Some(ready) = Waiter::take_plain_wake_handle(first.cast::<Waiter<()>>())
                {
                    lists.held.remove_first(first);
                    Waiter::settle_plain(first.cast::<Waiter<()>>());
                    pending[count].write(ready);
                    count += 1;
                }
                let is_last = lists.held.is_empty();
                drop(lists);
                for ready in &pending[..count] {
                    ready.assume_init_read().wake();
                }
                if is_last {
                    return match turn.yields_after_operation() {
                        true => Arrival::GaveWay,
                        false => Arrival::Done,
                    };
                }
                match self.lock_if_biased(turn) {
                    Some(again) if count > 0 => lists = again,
                    _ => return Arrival::Completes,
                }
            }
        }
    }
}
