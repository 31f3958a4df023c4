//! A send as a guard of an alternative.

use super::operation::{Phase, SendOp};
use crate::alternative::{Attempt, Guard, Plain, RawGuard, Terms};
use crate::core::{Ending, Sent};
use crate::error::SendError;
use crate::select_state::SelectState;
use crate::source::Source;
use crate::wait_point::WaitQueues;
use crate::waiter::{Outcome, Waiter};
use luna_core::current::{self, PendingWake};
use luna_core::wait_list::WaitNode;
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll};

impl<T, S: Source<T>> RawGuard for SendOp<'_, T, S> {
    #[inline]
    fn terms(&self) -> Terms<'_> {
        Terms {
            can_fail: true,
            ..Terms::at(self.sender.channel().wait_point(), &self.sender.chosen)
        }
    }

    unsafe fn attempt(
        self: Pin<&mut Self>,
        lists: Option<&mut WaitQueues>,
        cx: &mut Context<'_>,
    ) -> Attempt {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        let Some(lists) = lists else {
            return Attempt::NotReady;
        };
        // SAFETY: the contract: the lists are this channel's, and the node is new.
        let sent = unsafe {
            let mut locked = this.sender.channel().guard_of(lists);
            locked.send_now(this.offer_pointer(), Some(cx))
        };
        let (outcome, ready) = match sent {
            Sent::Full => return Attempt::NotReady,
            Sent::Done(ready, overwritten) => {
                if let Some(overwritten) = overwritten {
                    // SAFETY: the node has given its value away, and no other thread knows it.
                    unsafe { this.offered().waiter.put_value(overwritten) };
                    this.phase = Phase::Overwrote;
                    return Attempt::Ready(ready);
                }
                (Outcome::Done, ready)
            }
            Sent::Held(ready) => {
                this.phase = Phase::Listed;
                return Attempt::Ready(ready);
            }
            Sent::Ended(Ending::Poisoned) => (Outcome::Poisoned, PendingWake::NONE),
            Sent::Ended(_) => (Outcome::Closed, PendingWake::NONE),
            Sent::Broken(ready) => (Outcome::Broken, ready),
        };
        this.phase = Phase::Settled(outcome);
        Attempt::Ready(ready)
    }

    unsafe fn list(
        self: Pin<&mut Self>,
        lists: &mut WaitQueues,
        select_state: NonNull<SelectState>,
        guard: u32,
    ) {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        // SAFETY: the contract: the lists are this channel's; the node is new, holds or can make
        // its value, and is withdrawn before it goes.
        unsafe {
            let node = this.begin(Some((select_state, guard)));
            let mut locked = this.sender.channel().guard_of(lists);
            locked.list_sender(node, current::priority(), None);
        }
        this.phase = Phase::Listed;
    }

    unsafe fn withdraw(self: Pin<&mut Self>) {
        if self.phase == Phase::Listed && self.outcome() == Outcome::Waiting {
            // SAFETY: the node was listed on the senders' side.
            drop(unsafe { self.sender.channel().withdraw(self.node(), true) });
        }
    }

    unsafe fn poll_chosen(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        if this.phase == Phase::Overwrote {
            this.phase = Phase::GaveWay;
            // SAFETY: in this phase the node holds it. The user's code, and no lock is held.
            drop(unsafe { this.offered().waiter.take_value() });
        }
        if matches!(this.phase, Phase::Listed | Phase::Settled(_)) {
            let mut outcome = this.outcome();
            if matches!(outcome, Outcome::Waiting | Outcome::Held) {
                // The committing thread holds the lock until it is settled. SAFETY: the node was
                // listed.
                outcome = unsafe { this.sender.channel().update_wake_handle(this.node(), cx) };
            }
            match outcome {
                // One that is held waits again when its receive is dropped.
                Outcome::Held | Outcome::Waiting => return Poll::Pending,
                Outcome::Broken => this.broken(),
                _ => {}
            }
        }
        Poll::Ready(())
    }

    fn released(&self) {
        self.sender.channel().ring();
    }

    fn note_logged(&self) {
        self.sender.channel().note_logged(true);
    }

    fn order(&self) -> u64 {
        match self.phase {
            // SAFETY: an operation with a replay log is listed on the slow path alone; it is
            // settled, since its alternative has chosen it.
            Phase::Listed if self.outcome() != Outcome::Waiting => unsafe {
                Waiter::order(self.node())
            },
            _ => 0,
        }
    }

    unsafe fn fail(self: Pin<&mut Self>) -> bool {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        this.phase = Phase::Settled(Outcome::Poisoned);
        true
    }
}

impl<T, S: Source<T>> Guard for SendOp<'_, T, S> {
    type Output = Result<(), SendError<S::Unsent>>;
    type Seed = Self;
    const PLAIN: bool = S::MAKE.is_none();

    #[inline]
    fn into_seed(self) -> Self {
        self
    }

    #[inline]
    fn from_seed(seed: Self) -> Self {
        seed
    }

    #[inline]
    fn is_open(&self) -> bool {
        // SAFETY: called for a new send; only its future knows its node.
        unsafe { &*self.offered.get() }.source.is_open()
    }

    #[inline(always)]
    fn plain(&self) -> Plain<'_> {
        Plain {
            wait_point: self.sender.channel().wait_point(),
            node: self.node().cast(),
            of_sender: true,
            stamp: &self.sender.chosen,
        }
    }

    #[inline(always)]
    fn note_listed(self: Pin<&mut Self>) {
        // SAFETY: nothing is moved.
        unsafe { self.get_unchecked_mut() }.phase = Phase::Listed;
    }

    #[inline(always)]
    unsafe fn meet(self: Pin<&mut Self>, partner: NonNull<WaitNode>) {
        // SAFETY: nothing is moved. A plain and new send's node holds its value; by the contract
        // the partner is a plain receiver's node of this channel, which holds none.
        unsafe {
            let this = self.get_unchecked_mut();
            Waiter::put_value_of(partner.cast(), Waiter::take_value_of(this.node()));
            this.phase = Phase::Settled(Outcome::Done);
        }
    }

    #[inline(always)]
    unsafe fn output(self: Pin<&mut Self>) -> Self::Output {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        if this.phase == Phase::GaveWay {
            this.phase = Phase::Over;
            return Ok(());
        }
        let outcome = this.outcome();
        this.settled(outcome)
    }
}
