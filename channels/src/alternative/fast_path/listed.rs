//! Guards that wait: they are listed, one is chosen by a partner, and the others are withdrawn.

use super::{Ends, Finish, PlainGuard, Visit};
use crate::alternative::guard::Guard;
use crate::select_state::SelectState;
use crate::wait_point::{LastUser, WaitPoint, WaitQueues, Waiting};
use crate::waiter::{Outcome, Waiter};
use core::pin::Pin;
use core::ptr::NonNull;
use luna_core::current::PlainTurn;
use luna_core::wait_list::WaitNode;

/// Lists the guards, none of which is ready, and releases the locks that [`Looks`](super::Looks)
/// have kept.
#[derive(Debug)]
pub(in crate::alternative) struct Listing<'a> {
    turn: PlainTurn<'a>,
    /// The process: read once.
    user: LastUser,
    select_state: NonNull<SelectState>,
}

impl<'a> Listing<'a> {
    /// # Safety
    ///
    /// The guards are pinned, hold their values if they are senders', and withdraw their nodes
    /// before they and the select state go.
    #[inline(always)]
    pub(in crate::alternative) unsafe fn of(
        turn: PlainTurn<'a>,
        select_state: NonNull<SelectState>,
    ) -> Self {
        Self {
            turn,
            user: LastUser::process(turn.process().id()),
            select_state,
        }
    }
}

impl Visit for Listing<'_> {
    #[inline(always)]
    fn visit<G: Guard>(&mut self, number: u32, guard: Pin<&mut G>) -> bool {
        let PlainGuard {
            wait_point,
            node,
            of_sender,
            ..
        } = guard.plain();
        // SAFETY: the look has kept the lock, on this thread. The node is new, so no other thread
        // knows it.
        unsafe {
            let mut lists = wait_point.kept(self.turn);
            Waiter::<()>::begin_guard_alone(node.cast(), self.select_state, number);
            lists.note_user(of_sender, self.user);
            match lists.waiting.is_idle() {
                true => lists.waiting = Waiting::alone_guard(node, of_sender),
                false => list_in_queue(&mut lists, node, of_sender),
            }
        }
        guard.note_listed();
        true
    }
}

/// Lists a guard where others of its side wait.
///
/// # Safety
///
/// The node was begun as a guard that waits alone, and is not listed. It is taken off before it
/// goes.
#[cold]
#[inline(never)]
unsafe fn list_in_queue(lists: &mut WaitQueues, node: NonNull<WaitNode>, of_sender: bool) {
    lists.list_lone();
    // SAFETY: the node was begun as a guard and is not settled, since it was never listed; the
    // lists show that the lock is held. It is in none, and its owner takes it off before it goes,
    // as is demanded here.
    unsafe {
        Waiter::<()>::complete_guard(node.cast());
        let priority = node.as_ref().priority();
        match of_sender {
            true => lists.senders.insert(node, priority, None),
            false => lists.receivers.insert(node, priority, None),
        }
    }
}

/// Takes the output of a listed guard, if it is done; then its end gets its new stamp.
#[derive(Debug)]
pub(in crate::alternative) struct Chosen<const FAIR: bool> {
    /// As they were when the guards were listed. What this thread has chosen since has a smaller
    /// stamp than its next choice.
    pub(in crate::alternative) ends: Ends<FAIR>,
}

impl<const FAIR: bool> Finish for Chosen<FAIR> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    unsafe fn finish<G: Guard>(self, guard: Pin<&mut G>) -> Option<G::Output> {
        let plain = guard.plain();
        // SAFETY: the node was begun when it was listed.
        let outcome = unsafe { Waiter::outcome(plain.node.cast::<Waiter<()>>()) };
        if outcome != Outcome::Done {
            return None;
        }
        self.ends.choose(plain.stamp);
        // SAFETY: it is done, and its output was not taken yet, as is demanded here.
        Some(unsafe { guard.output_when_done() })
    }
}

/// Withdraws the guards that were listed and not chosen. The chosen one is over.
#[derive(Debug)]
pub(in crate::alternative) struct Withdrawing<'a> {
    pub(in crate::alternative) turn: PlainTurn<'a>,
}

impl Visit for Withdrawing<'_> {
    #[inline(always)]
    fn visit<G: Guard>(&mut self, _: u32, guard: Pin<&mut G>) -> bool {
        let guard = guard.plain();
        let node = guard.node.cast::<Waiter<()>>();
        // SAFETY: the node was begun when it was listed. This thread holds no other lock of a wait
        // point, and under the lock a waiting node is listed. The chosen one is over.
        unsafe {
            if Waiter::is_waiting(node) {
                match guard.wait_point.enter_in(self.turn.here()) {
                    Some(mut lists)
                        if lists.waiting == Waiting::alone_guard(guard.node, guard.of_sender) =>
                    {
                        lists.set_nothing_waits();
                        Waiter::settle_stale(node);
                    }
                    lists => {
                        drop(lists);
                        withdraw_queued(guard.wait_point, guard.node, guard.of_sender);
                    }
                }
            }
        }
        true
    }
}

/// Withdraws a guard that may be in a queue, if it still waits.
///
/// # Safety
///
/// It was listed at this wait point, and this is its owner.
#[cold]
#[inline(never)]
unsafe fn withdraw_queued(wait_point: &WaitPoint, node: NonNull<WaitNode>, of_sender: bool) {
    // No server is boosted by waiters here: clients' calls are no plain operations.
    let mut lists = wait_point.lock_lists();
    // SAFETY: the node was listed here, and its owner, which calls this, keeps it. The lock lists
    // one that waits alone; so under it a node that waits is in the queue of its side.
    unsafe {
        if Waiter::<()>::is_waiting(node.cast()) {
            match of_sender {
                true => lists.senders.remove(node),
                false => lists.receivers.remove(node),
            }
            Waiter::<()>::settle_stale(node.cast());
        }
    }
}
