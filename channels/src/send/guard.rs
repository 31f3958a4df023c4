//! A send as a guard of an alternative.

use super::operation::{Phase, SendOp};
use crate::alternative::{Attempt, Guard, Look, RawGuard};
use crate::core::{Ending, Sent};
use crate::error::SendError;
use crate::select_state::SelectState;
use crate::source::Source;
use crate::stamp::Stamp;
use crate::wait_point::{WaitPoint, WaitQueues};
use crate::waiter::{Outcome, Waiter};
use luna_core::current::{self, PendingWake, PlainPendingWake, Process};
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll};

impl<T, S: Source<T>> RawGuard for SendOp<'_, T, S> {
    fn place(&self) -> Option<NonNull<WaitPoint>> {
        Some(NonNull::from(self.sender.channel().place()))
    }

    fn is_open(&self) -> bool {
        // SAFETY: called for a new send; only its future knows its node.
        unsafe { &*self.offered.get() }.source.is_open()
    }

    fn stamp(&self) -> Option<&Stamp> {
        Some(&self.sender.chosen)
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
            let mut section = this.sender.channel().section(lists);
            section.send_now(this.place_of_offer(), Some(cx))
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
            Sent::Ended(Ending::Poisoned) => (Outcome::Poisoned, PendingWake::NOBODY),
            Sent::Ended(_) => (Outcome::Closed, PendingWake::NOBODY),
            Sent::Broken(ready) => (Outcome::Broken, ready),
        };
        this.phase = Phase::Settled(outcome);
        Attempt::Ready(ready)
    }

    unsafe fn list(
        self: Pin<&mut Self>,
        lists: &mut WaitQueues,
        selection: NonNull<SelectState>,
        guard: u32,
    ) {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        // SAFETY: the contract: the lists are this channel's; the node is new, holds or can make
        // its value, and is withdrawn before it goes.
        unsafe {
            let node = this.begin(Some((selection, guard)));
            let mut section = this.sender.channel().section(lists);
            section.list_sender(node, current::priority(), None);
        }
        this.phase = Phase::Listed;
    }

    unsafe fn withdraw(self: Pin<&mut Self>) {
        if self.phase == Phase::Listed && self.outcome() == Outcome::Waiting {
            // SAFETY: the node was listed on the senders' side.
            drop(unsafe { self.sender.channel().withdraw(self.node(), true) });
        }
    }

    #[inline]
    unsafe fn look_fast(self: Pin<&mut Self>, home: u64) -> Look {
        if S::MAKE.is_some() {
            return Look::No;
        }
        // SAFETY: the contract.
        unsafe { self.sender.channel().look_for_receiver(home) }
    }

    #[inline]
    unsafe fn leave_home(self: Pin<&mut Self>, home: u64) {
        // SAFETY: the contract.
        unsafe { self.sender.channel().leave_home(home) };
    }

    #[inline]
    unsafe fn take_fast(self: Pin<&mut Self>, process: &Process) -> Option<PlainPendingWake> {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        // SAFETY: the contract: a new send's node holds its value, since none is made, and is known
        // to its future alone.
        let ready = unsafe { this.sender.channel().take_receiver(this.node(), process) };
        this.phase = Phase::Settled(Outcome::Done);
        ready
    }

    #[inline]
    unsafe fn list_fast(
        self: Pin<&mut Self>,
        process: &Process,
        selection: NonNull<SelectState>,
        guard: u32,
    ) {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        let (node, channel) = (this.node(), this.sender.channel());
        // SAFETY: the contract: the node is new, holds its value, and is withdrawn before it goes.
        unsafe { channel.list_guard(node, true, (selection, guard), process) };
        this.phase = Phase::Listed;
    }

    #[inline]
    unsafe fn withdraw_fast(self: Pin<&mut Self>, home: u64) {
        if self.phase == Phase::Listed {
            let channel = self.sender.channel();
            // SAFETY: the node was listed on the senders' side.
            unsafe { channel.withdraw_guard(self.node(), true, home) };
        }
    }

    #[inline]
    fn is_over(&self) -> bool {
        matches!(self.phase, Phase::Listed | Phase::Settled(_)) && self.outcome() == Outcome::Done
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
                // The claiming thread holds the lock until it is settled. SAFETY: the node was
                // listed.
                outcome = unsafe { this.sender.channel().update_wakeup(this.node(), cx) };
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

    fn can_fail(&self) -> bool {
        true
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

    #[inline]
    fn into_seed(self) -> Self {
        self
    }

    #[inline]
    fn from_seed(seed: Self) -> Self {
        seed
    }

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
