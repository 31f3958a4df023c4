//! A party's coming to a barrier.

use super::{Barrier, Shared};
use crate::alternative::{Attempt, Guard, RawGuard};
use crate::select_state::SelectState;
use crate::stamp::Stamp;
use crate::wait_point::{WaitPoint, WaitQueues};
use crate::waiter::{Outcome, Waiter};
use luna_core::current::{self, PendingWake, Renewal, WakeHandle};
use luna_platform::sync::atomic::Ordering;
use std::cell::UnsafeCell;
use std::fmt;
use std::future::Future;
use std::marker::PhantomPinned;
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll};

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

/// What [`SyncOp::come`] has led to. Its caller carries it out once its own state is changed, since
/// all of it may run user code.
#[must_use]
pub(super) struct Came {
    /// The round is complete.
    pub(super) is_complete: bool,
    /// This party has completed it, and the others are to be [released](Shared::release).
    pub(super) completes: bool,
    /// Not needed any more.
    pub(super) former: [Option<WakeHandle>; 2],
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

impl<'a> SyncOp<'a> {
    pub(super) fn new(barrier: &'a Barrier) -> Self {
        SyncOp {
            barrier,
            node: UnsafeCell::new(Waiter::empty()),
            phase: Phase::New,
            _pinned: PhantomPinned,
        }
    }

    fn shared(&self) -> &'a Shared {
        self.barrier.shared()
    }

    fn node(&self) -> NonNull<Waiter<()>> {
        // SAFETY: a cell's address is never null.
        unsafe { NonNull::new_unchecked(self.node.get()) }
    }

    /// The outcome of a listed party.
    fn outcome(&self) -> Outcome {
        // SAFETY: the node lies in this future, and was begun before it was listed.
        unsafe { Waiter::outcome(self.node()) }
    }

    /// For a listed party: whether the round is complete; if so, it is in no list any more.
    /// Otherwise the poller's waker from `cx` is woken then.
    fn poll_round(&mut self, cx: &Context<'_>) -> Poll<()> {
        if self.outcome() == Outcome::Done {
            return Poll::Ready(());
        }
        let mut renewal = Renewal::of(cx);
        let mut _former = None;
        let polled = renewal.put(|renewal| {
            let mut lists = self.shared().place.lock();
            // SAFETY: under the lock a waiting node may be changed, and the round's number
            // determines its list.
            unsafe {
                if self.outcome() == Outcome::Done {
                    return Poll::Ready(());
                }
                let node = Waiter::link(self.node());
                if self.shared().round(&lists, |round| round.number) == (*node).ticket {
                    renewal.store((*node).wait.wakeup_mut());
                    return Poll::Pending;
                }
                lists.held.remove(self.node().cast());
                (*node)
                    .outcome
                    .store(Outcome::Done as u8, Ordering::Relaxed);
                _former = (*node).wait.wakeup_mut().take();
                Poll::Ready(())
            }
        });
        if polled.is_pending() {
            self.shared().place.waits();
        }
        polled
    }

    /// Comes, or looks whether the round is complete, for a group that is one party: all at once,
    /// without user code. `wakeup` is for the group. Not to be called once the round is complete.
    ///
    /// # Safety
    ///
    /// It is pinned, and in no alternative.
    pub(super) unsafe fn come(&mut self, wakeup: WakeHandle) -> Came {
        let shared = self.shared();
        let waits = |former| Came {
            is_complete: false,
            completes: false,
            former: [former, None],
        };
        let is_over = |completes, former| Came {
            is_complete: true,
            completes,
            former,
        };
        let is_new = self.phase == Phase::New;
        if is_new {
            shared.note_user();
        } else if self.outcome() == Outcome::Done {
            self.phase = Phase::Over;
            return is_over(false, [Some(wakeup), None]);
        }
        let mut lists = shared.place.lock();
        // SAFETY: the lists are the barrier's. A new node is in none of them, is pinned by the
        // contract, and its drop takes it off. Under the lock a listed node may be changed, and the
        // round's number determines its list.
        unsafe {
            if is_new {
                if shared.complete_with(&mut lists, 1) {
                    self.phase = Phase::Over;
                    return is_over(true, [Some(wakeup), None]);
                }
                let number = shared.round(&lists, |round| {
                    round.arrived += 1;
                    round.number
                });
                Waiter::begin(self.node(), false, None, None);
                (*Waiter::link(self.node())).ticket = number;
                lists
                    .senders
                    .insert(self.node().cast(), current::priority(), Some(wakeup));
                self.phase = Phase::Listed;
                return waits(None);
            }
            let node = Waiter::link(self.node());
            let is_done = self.outcome() == Outcome::Done;
            let number = shared.round(&lists, |round| round.number);
            if !is_done && number == (*node).ticket {
                return waits((*node).wait.wakeup_mut().replace(wakeup));
            }
            if !is_done {
                lists.held.remove(self.node().cast());
                (*node)
                    .outcome
                    .store(Outcome::Done as u8, Ordering::Relaxed);
            }
            self.phase = Phase::Over;
            let former = if is_done {
                None
            } else {
                (*node).wait.wakeup_mut().take()
            };
            is_over(false, [Some(wakeup), former])
        }
    }

    /// Takes a listed party back, if the round is not complete. Returns whether the round is
    /// complete.
    pub(super) fn leave(&mut self) -> bool {
        let (is_complete, former) = self.take_back();
        // Dropping a waker can run anything, so at the end.
        drop(former);
        is_complete
    }

    /// As [`leave`](Self::leave), without user code: returns the handle to drop.
    pub(super) fn take_back(&mut self) -> (bool, Option<WakeHandle>) {
        match self.phase {
            Phase::Listed => {}
            Phase::New => return (false, None),
            Phase::Completed | Phase::GaveWay | Phase::Over => return (true, None),
        }
        self.shared().place.waits_no_more();
        let mut lists = self.shared().place.lock();
        // SAFETY: as in `poll_round`.
        unsafe {
            match self.outcome() {
                Outcome::Done => return (true, None),
                Outcome::Stale => return (false, None),
                _ => {}
            }
            let node = Waiter::link(self.node());
            let number = self.shared().round(&lists, |round| round.number);
            let is_complete = number != (*node).ticket;
            if is_complete {
                lists.held.remove(self.node().cast());
            } else if Waiter::selection(self.node()).is_some() {
                lists.receivers.remove(self.node().cast());
                self.shared().round(&lists, |round| round.offering -= 1);
            } else {
                lists.senders.remove(self.node().cast());
                self.shared().round(&lists, |round| round.arrived -= 1);
            }
            let outcome = if is_complete {
                Outcome::Done
            } else {
                Outcome::Stale
            };
            (*node).outcome.store(outcome as u8, Ordering::Relaxed);
            let former = (*node).wait.wakeup_mut().take();
            drop(lists);
            (is_complete, former)
        }
    }
}

impl Future for SyncOp<'_> {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        // SAFETY: nothing pinned is moved: a listed node stays in its place.
        let this = unsafe { self.get_unchecked_mut() };
        if current::branch_failed() && matches!(this.phase, Phase::New | Phase::Listed) {
            // The missing parties may never come, and there is no error to return.
            let has_come = this.leave();
            this.phase = if has_come { Phase::Over } else { Phase::New };
            if has_come {
                return Poll::Ready(());
            }
            current::end_branch(cx);
            return Poll::Pending;
        }
        match this.phase {
            Phase::New => {}
            Phase::Listed => {
                let polled = this.poll_round(cx);
                if polled.is_ready() {
                    this.phase = Phase::Over;
                }
                return polled;
            }
            Phase::GaveWay => {
                this.phase = Phase::Over;
                return Poll::Ready(());
            }
            Phase::Completed | Phase::Over => panic!("a sync was polled after it was over"),
        }
        let shared = this.shared();
        shared.note_user();
        let mut renewal = Renewal::of(cx);
        renewal.put(|renewal| {
            let mut lists = shared.place.lock();
            // SAFETY: the lists are the barrier's; the node is in none of them, the future is
            // pinned, and its drop takes it off.
            unsafe {
                if shared.complete_with(&mut lists, 1) {
                    this.phase = Phase::Completed;
                } else if let Some(wakeup) = renewal.take() {
                    let number = shared.round(&lists, |round| {
                        round.arrived += 1;
                        round.number
                    });
                    Waiter::begin(this.node(), false, None, None);
                    (*Waiter::link(this.node())).ticket = number;
                    lists
                        .senders
                        .insert(this.node().cast(), current::priority(), wakeup);
                    this.phase = Phase::Listed;
                }
            }
        });
        if this.phase == Phase::Listed {
            shared.place.waits();
            return Poll::Pending;
        }
        this.phase = Phase::Over;
        shared.release();
        if crate::gives_way(cx) {
            this.phase = Phase::GaveWay;
            return Poll::Pending;
        }
        Poll::Ready(())
    }
}

impl RawGuard for SyncOp<'_> {
    fn place(&self) -> Option<NonNull<WaitPoint>> {
        Some(NonNull::from(&*self.shared().place))
    }

    fn stamp(&self) -> Option<&Stamp> {
        Some(&self.barrier.chosen)
    }

    fn claims_several(&self) -> bool {
        true
    }

    unsafe fn attempt(
        self: Pin<&mut Self>,
        lists: Option<&mut WaitQueues>,
        _: &mut Context<'_>,
    ) -> Attempt {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        let Some(lists) = lists else {
            return Attempt::NotReady;
        };
        this.shared().note_user();
        // SAFETY: the contract: the lists are this barrier's.
        if unsafe { this.shared().complete_with(lists, 1) } {
            this.phase = Phase::Completed;
            Attempt::Ready(PendingWake::NOBODY)
        } else {
            Attempt::NotReady
        }
    }

    unsafe fn list(
        self: Pin<&mut Self>,
        lists: &mut WaitQueues,
        selection: NonNull<SelectState>,
        guard: u32,
    ) {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        // SAFETY: by the contract, the lists are this barrier's; all nodes of its alternatives lead
        // to select states; the node is in none of the lists, and is taken off before it goes.
        unsafe {
            let mut before = None;
            let mut next = lists.receivers.first();
            while let Some(other) = next {
                let of_other = Waiter::<()>::selection(other.cast());
                let Some((of_other, _)) = of_other else {
                    break;
                };
                if of_other == selection {
                    // The barrier stands in another guard of this alternative already, and one is
                    // enough.
                    return;
                }
                if SelectState::order(of_other) > SelectState::order(selection) {
                    break;
                }
                before = next;
                next = lists.receivers.after(other);
            }
            Waiter::begin(this.node(), false, Some((selection, guard)), None);
            (*Waiter::link(this.node())).ticket = this.shared().round(lists, |round| {
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
        // SAFETY: nothing is moved.
        unsafe { self.get_unchecked_mut() }.leave();
    }

    unsafe fn poll_chosen(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        match this.phase {
            Phase::Completed => {
                this.phase = Phase::GaveWay;
                this.shared().release();
                Poll::Ready(())
            }
            Phase::Listed => this.poll_round(cx),
            _ => Poll::Ready(()),
        }
    }

    unsafe fn fail(self: Pin<&mut Self>) -> bool {
        false
    }
}

impl Guard for SyncOp<'_> {
    type Output = ();
    type Seed = Self;

    #[inline]
    fn into_seed(self) -> Self {
        self
    }

    #[inline]
    fn from_seed(seed: Self) -> Self {
        seed
    }

    unsafe fn output(self: Pin<&mut Self>) {
        // SAFETY: nothing is moved.
        unsafe { self.get_unchecked_mut() }.phase = Phase::Over;
    }
}

impl Drop for SyncOp<'_> {
    fn drop(&mut self) {
        match self.phase {
            Phase::Listed => {
                self.leave();
            }
            // The round is complete, whatever becomes of this party.
            Phase::Completed => self.shared().release(),
            Phase::New | Phase::GaveWay | Phase::Over => {}
        }
    }
}

impl fmt::Debug for SyncOp<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SyncOp")
            .field("phase", &self.phase)
            .finish_non_exhaustive()
    }
}
