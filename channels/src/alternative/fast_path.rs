//! Fast path of alternatives, independent of the types of values: all guards are plain operations,
//! and the locks of all their wait points are biased to this executor.
//!
//! The decision is made as in [`choose`](super::choose): under the locks of all wait points that
//! are looked at. They are taken by plain stores and in no particular order: a thread that wants a
//! lock which this thread is inside waits until it is left, and this thread waits for no other in
//! between.
//!
//! ```text
//!   owner:    look at each --one is ready--> leave the others, move the value, let the partner go
//!                 |
//!                 '--none--> open the select state, list each guard and leave its wait point
//!   partner:  finds a guard: commits its select state, moves the value, settles the guard
//!   owner:    withdraws the other guards
//! ```
//!
//! Where nothing else waits, a guard waits alone, outside of the queues: see
//! [`Waiting`](crate::wait_point::Waiting).

mod listed;
mod looking;

pub(super) use listed::{Chosen, Listing, Withdrawing};
pub(super) use looking::{Found, Looks};

use super::guard::Guard;
use crate::select_state::SelectState;
use crate::stamp::Stamp;
use crate::wait_point::WaitPoint;
use crate::waiter::Waiter;
use core::pin::Pin;
use core::ptr::NonNull;
use luna_core::current::{PlainPendingWake, PlainTurn};
use luna_core::wait_list::{WaitList, WaitNode};

/// A guard on the fast path: a plain send or receive, of which the value does not matter.
#[derive(Debug, Clone, Copy)]
pub struct PlainGuard<'a> {
    pub(crate) wait_point: &'a WaitPoint,
    /// The first field of the guard's waiter.
    pub(crate) node: NonNull<WaitNode>,
    pub(crate) of_sender: bool,
    /// Stamp of its end.
    pub(crate) stamp: &'a Stamp,
}

/// A step on each guard of a list. The guards are those of one alternative, and this is the plain
/// turn of its process.
pub trait Visit {
    /// Goes to a guard. Returns whether to go on to the next one.
    fn visit<G: Guard>(&mut self, number: u32, guard: Pin<&mut G>) -> bool;
}

/// The last step on the guard that an alternative has chosen.
///
/// A build without optimization keeps each copy of an output in the frame of the function that
/// makes it. So what returns an output is inlined with optimization alone, or the frame of the poll
/// would hold the copies of all.
pub trait Finish {
    /// The output of the guard, if it is over.
    ///
    /// # Safety
    ///
    /// The guard was chosen, and its output was not taken yet. The steps say what else they demand.
    unsafe fn finish<G: Guard>(self, guard: Pin<&mut G>) -> Option<G::Output>;
}

/// The greatest stamp among the ends of an alternative, if it is fair; else no end has one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ends<const FAIR: bool> {
    greatest: u64,
}

impl<const FAIR: bool> Ends<FAIR> {
    pub(super) const fn new() -> Self {
        Self { greatest: 0 }
    }

    /// Notes an end; returns when it was last chosen.
    #[inline(always)]
    fn note(&mut self, stamp: &Stamp) -> u64 {
        if !FAIR {
            return 0;
        }
        let stamp = stamp.get();
        self.greatest = self.greatest.max(stamp);
        stamp
    }

    /// Gives the chosen end its new stamp, after all were noted.
    #[inline(always)]
    fn choose(self, chosen: &Stamp) {
        if FAIR {
            chosen.choose(self.greatest);
        }
    }
}

/// Result of a partner's attempt to commit the alternative of a guard.
pub(crate) enum Commit {
    /// It has chosen this guard. The caller takes the guard off and settles it.
    Chosen(PlainPendingWake),
    /// It has chosen another one. The caller takes the guard off, and settles it as stale.
    Stale,
    /// Not to be done on the fast path.
    No,
}

/// Commits an alternative through this guard of it.
///
/// # Safety
///
/// The guard waits at a wait point in whose lock this thread is: so the select state is live.
#[inline(always)]
pub(crate) unsafe fn commit(
    (select_state, guard): (NonNull<SelectState>, u32),
    turn: PlainTurn<'_>,
) -> Commit {
    // SAFETY: the guard waits, and its owner needs the wait point's lock, which is held, to
    // withdraw it: so its select state is live. No thread holds a commit lock across a poll, and
    // this one has not entered it yet. Then this is a partner in the commit lock, by its bias.
    unsafe {
        let select_state = select_state.as_ref();
        if !select_state.is_open() {
            return Commit::Stale;
        }
        // The commit lock of a select state that the fast path has opened is biased too.
        let Some(_commit_lock) = select_state.commit_lock_if_biased(turn) else {
            return Commit::No;
        };
        match select_state.commit_plainly(guard) {
            Some(ready) => Commit::Chosen(ready),
            None => Commit::No,
        }
    }
}

/// Takes the first operation off a queue, and guards of alternatives that have chosen before it.
/// `None`: the first operation needs the slow path; `Some(None)`: the queue is empty. The caller
/// settles the operation.
///
/// # Safety
///
/// The queue is that of one side of a plain channel without a buffer, in whose lock this thread is.
#[inline(never)]
pub(crate) unsafe fn take_first(
    queue: &mut WaitList,
    turn: PlainTurn<'_>,
) -> Option<Option<(NonNull<WaitNode>, PlainPendingWake)>> {
    while let Some(first) = queue.first() {
        // SAFETY: the node is listed, and this thread holds the lock that guards it by its bias: so
        // it is live, and no other thread withdraws it. A stale one is settled after it was taken
        // off.
        unsafe {
            let found = match Waiter::<()>::take_plain_wake_handle(first.cast()) {
                Some(ready) => Commit::Chosen(ready),
                None => match Waiter::<()>::select_state(first.cast()) {
                    Some(select_state) => commit(select_state, turn),
                    None => Commit::No,
                },
            };
            match found {
                Commit::Chosen(ready) => {
                    queue.remove_first(first);
                    return Some(Some((first, ready)));
                }
                Commit::Stale => {
                    queue.remove_first(first);
                    Waiter::<()>::settle_stale(first.cast());
                }
                Commit::No => return None,
            }
        }
    }
    Some(None)
}
