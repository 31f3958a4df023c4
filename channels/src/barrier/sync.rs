//! A party's coming to a barrier.

use super::{Barrier, BarrierPoint, Round};
use crate::alternative::{Attempt, Guard, RawGuard, Terms, own_seed};
use crate::guarded_wait_point::Locked;
use crate::in_place::InPlace;
use crate::select_state::SelectState;
use crate::wait_point::{Lists, WaitQueues};
use crate::waiter::{Outcome, Waiter, Waits};
use core::cell::UnsafeCell;
use core::future::Future;
use core::marker::PhantomPinned;
use core::pin::Pin;
use core::ptr::NonNull;
use core::task::{Context, Poll};
use luna_core::current::{self, PendingWake, Renewal, Turn};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SyncPhase {
    New,
    /// The node is in one of the barrier's lists, or was settled.
    Listed,
    /// It came last, in an alternative, and the others are to be released.
    Completed,
    /// All have come; the process lets others run before it continues.
    GaveWay,
    Over,
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
    phase: SyncPhase,
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
            phase: SyncPhase::New,
            _pinned: PhantomPinned,
        }
    }

    #[inline]
    fn point(&self) -> &'a BarrierPoint {
        &self.barrier.point
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

    /// Comes: completes the round, or waits.
    #[inline(never)]
    fn arrive(&mut self, turn: Turn<'_>) -> Poll<()> {
        if let Some(plain) = turn.plain()
            && let Some(locked) = self.point().enter_in(turn.here())
        {
            return self.arrive_under(locked, plain, turn);
        }
        self.arrive_otherwise(turn)
    }

    /// Comes in a turn that is not plain, or where the lock is not biased to its executor.
    #[cold]
    #[inline(never)]
    fn arrive_otherwise(&mut self, turn: Turn<'_>) -> Poll<()> {
        let (point, here) = (self.point(), turn.here());
        if turn.branch_failed() {
            return self.end_branch(turn);
        }
        point.note_user();
        let handle = turn.wake_handle();
        self.arrive_under(point.lock_in(here), (here, handle), turn)
    }

    /// Comes under the lock of its barrier, in whichever way it is held.
    #[inline(always)]
    fn arrive_under(
        &mut self,
        mut locked: Locked<'_, Round, impl Lists>,
        waits: impl Waits,
        turn: Turn<'_>,
    ) -> Poll<()> {
        match locked.is_missing_more() {
            true => self.wait(locked, waits),
            false => self.arrive_last(locked, waits, turn),
        }
    }

    /// All others have come, or offer to. A function of its own, so that no register is saved for
    /// it where the party waits.
    #[inline(never)]
    fn arrive_last(
        &mut self,
        mut locked: Locked<'_, Round, impl Lists>,
        waits: impl Waits,
        turn: Turn<'_>,
    ) -> Poll<()> {
        if !locked.complete_with(1) {
            return self.wait(locked, waits);
        }
        self.phase = SyncPhase::Over;
        if self.point().release_some(locked, turn.here()) {
            self.point().release();
        }
        self.let_others_run(turn)
    }

    #[inline(always)]
    fn wait(&mut self, mut locked: Locked<'_, Round, impl Lists>, waits: impl Waits) -> Poll<()> {
        let round = locked.state();
        round.arrived += 1;
        let number = round.number;
        // SAFETY: the lock is held. A new node is in no list, is pinned, as its callers are, and
        // its drop takes it off.
        unsafe {
            Waiter::begin_for(self.node(), waits, number);
            locked.arrived().insert_again(self.node().cast());
        }
        self.phase = SyncPhase::Listed;
        drop(locked);
        self.point().waits();
        Poll::Pending
    }

    /// Looks whether the round is complete: it is listed, and was polled again.
    #[cold]
    fn poll_listed(&mut self, cx: &Context<'_>) -> Poll<()> {
        let point = self.point();
        let mut renewal = Renewal::of(cx);
        let polled = renewal.put(|renewal| {
            let mut locked = point.lock();
            // SAFETY: under the lock a listed node may be changed, and the round's number
            // determines its list.
            unsafe {
                let node = Waiter::link(self.node());
                if self.outcome() == Outcome::Done {
                    return Poll::Ready(None);
                }
                if locked.state().number == (*node).ticket {
                    renewal.store((*node).wait.wake_handle_mut());
                    return Poll::Pending;
                }
                locked.released().remove(self.node().cast());
                Waiter::set_outcome(self.node(), Outcome::Done);
                Poll::Ready((*node).wait.wake_handle_mut().take())
            }
        });
        match polled {
            Poll::Pending => {
                point.waits();
                Poll::Pending
            }
            // The former handle is dropped at the end: that may run user code.
            Poll::Ready(_former) => {
                self.phase = SyncPhase::Over;
                Poll::Ready(())
            }
        }
    }

    /// It has completed the round, and released the others.
    #[inline(always)]
    fn let_others_run(&mut self, turn: Turn<'_>) -> Poll<()> {
        if turn.yields_after_operation() {
            self.phase = SyncPhase::GaveWay;
            return Poll::Pending;
        }
        Poll::Ready(())
    }

    /// Polls one that has come, and is not known to be done.
    #[cold]
    #[inline(never)]
    fn poll_again(&mut self, turn: Turn<'_>) -> Poll<()> {
        match self.phase {
            SyncPhase::New | SyncPhase::Listed if turn.branch_failed() => self.end_branch(turn),
            SyncPhase::New => self.arrive(turn),
            SyncPhase::Listed => self.poll_listed(&turn.context()),
            SyncPhase::GaveWay => {
                self.phase = SyncPhase::Over;
                Poll::Ready(())
            }
            SyncPhase::Completed | SyncPhase::Over => panic!("a sync was polled after it was over"),
        }
    }

    /// The missing parties may never come, and there is no error to return.
    #[cold]
    fn end_branch(&mut self, turn: Turn<'_>) -> Poll<()> {
        if self.leave() {
            self.phase = SyncPhase::Over;
            return Poll::Ready(());
        }
        self.phase = SyncPhase::New;
        current::end_branch(&turn.context());
        Poll::Pending
    }

    /// Its future goes before it has seen the end of the round.
    #[cold]
    fn drop_early(&mut self) {
        match self.phase {
            SyncPhase::Listed => {
                self.leave();
            }
            // The round is complete, whatever becomes of this party.
            _ => self.point().release(),
        }
    }

    /// Takes a listed party back, if the round is not complete. Returns whether the round is
    /// complete.
    fn leave(&mut self) -> bool {
        match self.phase {
            SyncPhase::Listed => {}
            SyncPhase::New => return false,
            SyncPhase::Completed | SyncPhase::GaveWay | SyncPhase::Over => return true,
        }
        self.point().waits_no_more();
        let mut locked = self.point().lock();
        // SAFETY: the node was listed and is this future's. Under the lock one that is not settled
        // is in a list, which the round's number and its select state determine.
        unsafe {
            match self.outcome() {
                Outcome::Done => return true,
                Outcome::Stale => return false,
                _ => {}
            }
            let node = Waiter::link(self.node());
            let is_complete = locked.state().number != (*node).ticket;
            if is_complete {
                locked.released().remove(self.node().cast());
            } else if Waiter::select_state(self.node()).is_some() {
                locked.offering().remove(self.node().cast());
                locked.state().offering -= 1;
            } else {
                locked.arrived().remove(self.node().cast());
                locked.state().arrived -= 1;
            }
            let outcome = match is_complete {
                true => Outcome::Done,
                false => Outcome::Stale,
            };
            Waiter::set_outcome(self.node(), outcome);
            let former = (*node).wait.wake_handle_mut().take();
            drop(locked);
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
        match this.phase {
            SyncPhase::New => this.arrive(Turn::of(cx)),
            SyncPhase::Listed if this.outcome() == Outcome::Done => {
                this.phase = SyncPhase::Over;
                Poll::Ready(())
            }
            _ => this.poll_again(Turn::of(cx)),
        }
    }
}

// SAFETY: it borrows its barrier, which keeps the wait point; its drop takes it off the list.
unsafe impl RawGuard for SyncOp<'_> {
    fn terms(&self) -> Terms {
        Terms::at(self.point(), &self.barrier.chosen)
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
        this.point().note_user();
        if this.point().locked(lists).complete_with(1) {
            this.phase = SyncPhase::Completed;
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
        let mut locked = this.point().locked(lists);
        // SAFETY: the lock is held. All nodes of its alternatives lead to select states, live while
        // they are listed, as this one will be. The new node is in none of the lists, and is taken
        // off before it goes.
        unsafe {
            let mut before = None;
            let mut next = locked.offering().first();
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
                next = locked.offering().after(other);
            }
            Waiter::begin(this.node(), Some((select_state, guard)));
            let round = locked.state();
            round.offering += 1;
            (*Waiter::link(this.node())).ticket = round.number;
            locked
                .offering()
                .insert_after(before, this.node().cast(), current::priority(), None);
        }
        this.phase = SyncPhase::Listed;
    }

    unsafe fn withdraw(self: Pin<&mut Self>) {
        self.in_place().leave();
    }

    unsafe fn poll_chosen(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let this = self.in_place();
        match this.phase {
            SyncPhase::Completed => {
                this.phase = SyncPhase::GaveWay;
                this.point().release();
                Poll::Ready(())
            }
            SyncPhase::Listed if this.outcome() != Outcome::Done => this.poll_listed(cx),
            _ => Poll::Ready(()),
        }
    }
}

impl Guard for SyncOp<'_> {
    type Output = ();

    own_seed!();

    unsafe fn output(self: Pin<&mut Self>) {
        self.in_place().phase = SyncPhase::Over;
    }
}

impl Drop for SyncOp<'_> {
    #[inline]
    fn drop(&mut self) {
        if matches!(self.phase, SyncPhase::Listed | SyncPhase::Completed) {
            self.drop_early();
        }
    }
}

luna_platform::debug_fields!(SyncOp<'_>, |op| phase: op.phase);
