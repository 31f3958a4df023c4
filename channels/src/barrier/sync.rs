//! A party's coming to a barrier.

use super::fast_path::Arrival;
use super::{Barrier, Meeting};
use crate::alternative::{Attempt, Guard, RawGuard, Terms, own_seed};
use crate::in_place::InPlace;
use crate::select_state::SelectState;
use crate::wait_point::WaitQueues;
use crate::waiter::{Outcome, Waiter};
use core::cell::UnsafeCell;
use core::future::Future;
use core::marker::PhantomPinned;
use core::pin::Pin;
use core::ptr::NonNull;
use core::task::{Context, Poll};
use luna_core::current::{self, PendingWake, PlainTurn, Renewal, WakeHandle};
use luna_platform::sync::atomic::Ordering;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    New,
    /// The node is in one of the barrier's lists, or was settled.
    Listed,
    /// It came last, in an alternative, and the others are to be released.
    Completed,
    /// All have come; the process lets others run before it continues.
    GaveWay,
    Over,
}

/// What one [look](SyncOp::look) at the barrier has led to. Its caller carries it out once its own
/// state is changed, since all of it may run user code.
#[must_use]
enum Came {
    /// The round is not complete.
    Waits,
    /// This party has completed the round, and the others are to be [released](Meeting::release).
    Completes,
    /// The round is complete. The wake handle is not needed any more.
    IsOver(Option<WakeHandle>),
}

/// Coming to a barrier: see [`Barrier::sync`].
///
/// # Invariants
///
/// In `Listed` it is pinned.
#[must_use = "an operation does nothing unless awaited or offered in an alternative"]
pub struct SyncOp<'a> {
    barrier: &'a Barrier,
    node: UnsafeCell<Waiter<()>>,
    phase: Phase,
    _pinned: PhantomPinned,
}

// SAFETY: a listed node is guarded by the barrier's lock wherever the future is.
unsafe impl Send for SyncOp<'_> {}
// SAFETY: `&SyncOp` gives access to nothing.
unsafe impl Sync for SyncOp<'_> {}

// SAFETY: no code of this file moves the node, or the whole, behind a pin.
unsafe impl InPlace for SyncOp<'_> {}

impl<'a> SyncOp<'a> {
    #[inline]
    pub(super) fn new(barrier: &'a Barrier) -> Self {
        SyncOp {
            barrier,
            node: UnsafeCell::new(Waiter::empty()),
            phase: Phase::New,
            _pinned: PhantomPinned,
        }
    }

    #[inline]
    fn meeting(&self) -> &'a Meeting {
        &self.barrier.meeting
    }

    #[inline]
    fn node(&self) -> NonNull<Waiter<()>> {
        NonNull::from(&self.node).cast()
    }

    /// The outcome of a listed party.
    #[inline]
    fn outcome(&self) -> Outcome {
        // SAFETY: the node lies in this future, and was begun before it was listed.
        unsafe { Waiter::outcome(self.node()) }
    }

    /// Comes, or looks whether the round is complete, under the barrier's lock. Runs no user code.
    /// While it waits, the handle of `renewal` is woken; without a handle nothing changes, and the
    /// renewal calls this again.
    ///
    /// # Safety
    ///
    /// It is pinned, new or listed, and in no alternative unless that has chosen it.
    unsafe fn look(&mut self, renewal: &mut Renewal<'_, '_>) -> Came {
        let meeting = self.meeting();
        let is_new = self.phase == Phase::New;
        let mut lists = meeting.lock();
        // SAFETY: the lists are the barrier's. A new node is in none of them, is pinned, as is
        // demanded here, and its drop takes it off. Under the lock a listed node may be changed,
        // and the round's number determines its list.
        unsafe {
            if is_new {
                if meeting.complete_with(&mut lists, 1) {
                    self.phase = Phase::Over;
                    return Came::Completes;
                }
                if let Some(wake_handle) = renewal.take() {
                    let number = meeting.state(&mut lists, |round, _| {
                        round.arrived += 1;
                        round.number
                    });
                    Waiter::begin(self.node(), false, None, None);
                    (*Waiter::link(self.node())).ticket = number;
                    lists
                        .senders
                        .insert(self.node().cast(), current::priority(), wake_handle);
                    self.phase = Phase::Listed;
                }
                return Came::Waits;
            }
            let node = Waiter::link(self.node());
            if self.outcome() == Outcome::Done {
                self.phase = Phase::Over;
                return Came::IsOver(None);
            }
            if meeting.state(&mut lists, |round, _| round.number) == (*node).ticket {
                renewal.store(Waiter::change_wake_handle(self.node()));
                return Came::Waits;
            }
            lists.held.remove(self.node().cast());
            (*node)
                .outcome
                .store(Outcome::Done as u8, Ordering::Relaxed);
            self.phase = Phase::Over;
            Came::IsOver((*node).wait.wake_handle_mut().take())
        }
    }

    /// Comes to the barrier, or looks whether the round is complete.
    fn poll_round(&mut self, cx: &Context<'_>) -> Poll<()> {
        let mut renewal = Renewal::of(cx);
        // SAFETY: its callers are polled pinned, in these phases.
        match renewal.put(|renewal| unsafe { self.look(renewal) }) {
            Came::Waits => {
                self.meeting().waits();
                Poll::Pending
            }
            Came::Completes => {
                self.meeting().release();
                self.let_others_run(cx)
            }
            Came::IsOver(_former) => Poll::Ready(()),
        }
    }

    /// It has completed the round, and released the others.
    fn let_others_run(&mut self, cx: &Context<'_>) -> Poll<()> {
        if crate::yield_after_operation(cx) {
            self.phase = Phase::GaveWay;
            return Poll::Pending;
        }
        Poll::Ready(())
    }

    /// Handles all that did not simply end on the fast path.
    #[inline(never)]
    fn poll_away(&mut self, arrival: Arrival, cx: &Context<'_>) -> Poll<()> {
        match arrival {
            Arrival::GaveWay => {
                self.phase = Phase::GaveWay;
                return Poll::Pending;
            }
            Arrival::Completes => {
                self.phase = Phase::Over;
                self.meeting().release();
                return self.let_others_run(cx);
            }
            _ => {}
        }
        match self.phase {
            Phase::New | Phase::Listed if current::branch_failed() => {
                // The missing parties may never come, and there is no error to return.
                let has_come = self.leave();
                self.phase = if has_come { Phase::Over } else { Phase::New };
                if has_come {
                    return Poll::Ready(());
                }
                current::end_branch(cx);
                return Poll::Pending;
            }
            Phase::New => self.meeting().note_user(),
            Phase::Listed => {}
            Phase::GaveWay => {
                self.phase = Phase::Over;
                return Poll::Ready(());
            }
            Phase::Completed | Phase::Over => panic!("a sync was polled after it was over"),
        }
        self.poll_round(cx)
    }

    /// Its future goes before it has seen the end of the round.
    #[cold]
    fn drop_early(&mut self) {
        match self.phase {
            Phase::Listed => {
                self.leave();
            }
            // The round is complete, whatever becomes of this party.
            _ => self.meeting().release(),
        }
    }

    /// Takes a listed party back, if the round is not complete. Returns whether the round is
    /// complete.
    fn leave(&mut self) -> bool {
        match self.phase {
            Phase::Listed => {}
            Phase::New => return false,
            Phase::Completed | Phase::GaveWay | Phase::Over => return true,
        }
        self.meeting().waits_no_more();
        let mut lists = self.meeting().lock();
        // SAFETY: the lists are the barrier's, and the node was listed and is this future's. Under
        // the lock one that is not settled is in a list, which the round's number and its select
        // state determine.
        unsafe {
            match self.outcome() {
                Outcome::Done => return true,
                Outcome::Stale => return false,
                _ => {}
            }
            let node = Waiter::link(self.node());
            let meeting = self.meeting();
            let number = meeting.state(&mut lists, |round, _| round.number);
            let is_complete = number != (*node).ticket;
            if is_complete {
                lists.held.remove(self.node().cast());
            } else if Waiter::select_state(self.node()).is_some() {
                lists.receivers.remove(self.node().cast());
                meeting.state(&mut lists, |round, _| round.offering -= 1);
            } else {
                lists.senders.remove(self.node().cast());
                meeting.state(&mut lists, |round, _| round.arrived -= 1);
            }
            let outcome = if is_complete {
                Outcome::Done
            } else {
                Outcome::Stale
            };
            (*node).outcome.store(outcome as u8, Ordering::Relaxed);
            let former = (*node).wait.wake_handle_mut().take();
            drop(lists);
            // Dropping a waker can run anything, so at the end.
            drop(former);
            is_complete
        }
    }
}

impl Future for SyncOp<'_> {
    type Output = ();

    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let this = self.in_place();
        let mut arrival = Arrival::SlowPath;
        match this.phase {
            Phase::New => {
                if let Some(turn) = PlainTurn::of(cx) {
                    // SAFETY: a new node is known to its future alone, which is pinned; its drop
                    // takes the node off.
                    arrival = unsafe { this.barrier.come_fast(this.node(), turn) };
                }
                match arrival {
                    Arrival::Waits => {
                        this.phase = Phase::Listed;
                        return Poll::Pending;
                    }
                    Arrival::Done => {
                        this.phase = Phase::Over;
                        return Poll::Ready(());
                    }
                    _ => {}
                }
            }
            Phase::Listed if this.outcome() == Outcome::Done => {
                this.phase = Phase::Over;
                return Poll::Ready(());
            }
            _ => {}
        }
        this.poll_away(arrival, cx)
    }
}

// SAFETY: it borrows its barrier, which keeps the wait point; its drop takes it off the list.
unsafe impl RawGuard for SyncOp<'_> {
    fn terms(&self) -> Terms<'_> {
        Terms {
            commits_several: true,
            ..Terms::at(self.meeting(), &self.barrier.chosen)
        }
    }

    unsafe fn attempt(
        self: Pin<&mut Self>,
        lists: Option<&mut WaitQueues>,
        _: &mut Context<'_>,
    ) -> Attempt {
        let this = self.in_place();
        let Some(lists) = lists else {
            return Attempt::NotReady;
        };
        this.meeting().note_user();
        if this.meeting().complete_with(lists, 1) {
            this.phase = Phase::Completed;
            Attempt::Ready(PendingWake::NONE)
        } else {
            Attempt::NotReady
        }
    }

    unsafe fn list(
        self: Pin<&mut Self>,
        lists: &mut WaitQueues,
        select_state: NonNull<SelectState>,
        guard: u32,
    ) {
        let this = self.in_place();
        // SAFETY: the lists are those of the guard's wait point, as is demanded here: this
        // barrier's. All nodes of its alternatives lead to select states, live while they are
        // listed, as this one will be. The new node is in none of the lists, and is taken off
        // before it goes.
        unsafe {
            let mut before = None;
            let mut next = lists.receivers.first();
            while let Some(other) = next {
                let of_other = Waiter::<()>::select_state(other.cast());
                let Some((of_other, _)) = of_other else {
                    break;
                };
                if of_other == select_state {
                    // The barrier stands in another guard of this alternative already, and one is
                    // enough.
                    return;
                }
                if SelectState::order(of_other) > SelectState::order(select_state) {
                    break;
                }
                before = next;
                next = lists.receivers.after(other);
            }
            Waiter::begin(this.node(), false, Some((select_state, guard)), None);
            (*Waiter::link(this.node())).ticket = this.meeting().state(lists, |round, _| {
                round.offering += 1;
                round.number
            });
            lists
                .receivers
                .insert_after(before, this.node().cast(), current::priority(), None);
        }
        this.phase = Phase::Listed;
    }

    unsafe fn withdraw(self: Pin<&mut Self>) {
        self.in_place().leave();
    }

    unsafe fn poll_chosen(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let this = self.in_place();
        match this.phase {
            Phase::Completed => {
                this.phase = Phase::GaveWay;
                this.meeting().release();
                Poll::Ready(())
            }
            Phase::Listed if this.outcome() != Outcome::Done => this.poll_round(cx),
            _ => Poll::Ready(()),
        }
    }
}

impl Guard for SyncOp<'_> {
    type Output = ();

    own_seed!();

    unsafe fn output(self: Pin<&mut Self>) {
        self.in_place().phase = Phase::Over;
    }
}

impl Drop for SyncOp<'_> {
    #[inline]
    fn drop(&mut self) {
        if matches!(self.phase, Phase::Listed | Phase::Completed) {
            self.drop_early();
        }
    }
}

luna_platform::debug_fields!(SyncOp<'_>, |op| phase: op.phase);
