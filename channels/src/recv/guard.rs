//! A receive as a guard of an alternative.

use super::Receiver;
use super::operation::{Phase, RecvOp};
use crate::alternative::{Attempt, Guard, Plain, RawGuard, Terms};
use crate::core::{Ending, Received};
use crate::error::RecvError;
use crate::extended::Mode;
use crate::select_state::SelectState;
use crate::wait_point::WaitQueues;
use crate::waiter::{Outcome, Waiter};
use luna_core::current::{self, PendingWake};
use luna_core::wait_list::WaitNode;
use std::mem::ManuallyDrop;
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll};

impl<T, M: Mode> RawGuard for RecvOp<'_, T, M> {
    #[inline]
    fn terms(&self) -> Terms<'_> {
        Terms {
            can_fail: true,
            ..Terms::at(self.receiver.channel().wait_point(), &self.receiver.chosen)
        }
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
        // SAFETY: the contract: the lists are this channel's.
        let mut locked = unsafe { this.receiver.channel().guard_of(lists) };
        if M::INHERITS {
            locked.note_server();
        }
        let received = locked.recv_now(M::HOLDS);
        let (outcome, ready) = match received {
            Received::Empty => return Attempt::NotReady,
            Received::Done(value, ready, holding) => {
                if M::INHERITS {
                    M::holds(this.note(), holding.priority);
                    locked.boost_while_they_wait();
                }
                this.keep(value, holding.ticket);
                (Outcome::Done, ready)
            }
            Received::Ended(Ending::Poisoned) => (Outcome::Poisoned, PendingWake::NONE),
            Received::Ended(_) => (Outcome::Closed, PendingWake::NONE),
            Received::Broken(ready) => (Outcome::Broken, ready),
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
        // SAFETY: the contract: the lists are this channel's; the node is new, and is withdrawn
        // before it goes.
        unsafe {
            let node = this.begin(Some((select_state, guard)));
            let mut locked = this.receiver.channel().guard_of(lists);
            locked.list_receiver(node, current::priority(), None);
        }
        this.phase = Phase::Listed;
    }

    unsafe fn withdraw(self: Pin<&mut Self>) {
        if self.phase == Phase::Listed && self.outcome() == Outcome::Waiting {
            // SAFETY: the node was listed on the receivers' side.
            drop(unsafe { self.receiver.channel().withdraw(self.node(), false) });
        }
    }

    unsafe fn poll_chosen(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let receiver = self.receiver;
        let mut outcome = self.outcome();
        if outcome == Outcome::Waiting {
            // The committing thread holds the lock until it is settled. SAFETY: the node was
            // listed.
            outcome = unsafe { self.receiver.channel().update_wake_handle(self.node(), cx) };
        }
        if outcome == Outcome::Broken {
            // SAFETY: nothing is moved.
            unsafe { self.get_unchecked_mut() }.phase = Phase::Settled(Outcome::Poisoned);
            receiver.poison();
        }
        Poll::Ready(())
    }

    fn note_logged(&self) {
        self.receiver.channel().note_logged(false);
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

impl<'a, T, M: Mode> Guard for RecvOp<'a, T, M> {
    type Output = Result<M::Received<'a, T>, RecvError>;
    type Seed = &'a Receiver<T>;
    const PLAIN: bool = !M::HOLDS && !M::INHERITS;
    // The value that it may hold was taken, or never came.
    const DROPS: bool = std::mem::needs_drop::<M::Note>();

    #[inline(always)]
    fn into_seed(self) -> Self::Seed {
        // A new one has nothing else, and nothing to drop.
        ManuallyDrop::new(self).receiver
    }

    #[inline(always)]
    fn from_seed(seed: Self::Seed) -> Self {
        RecvOp::new(seed)
    }

    #[inline(always)]
    fn plain(&self) -> Plain<'_> {
        Plain {
            wait_point: self.receiver.channel().wait_point(),
            node: self.node().cast(),
            of_sender: false,
            stamp: &self.receiver.chosen,
        }
    }

    #[inline(always)]
    fn note_listed(self: Pin<&mut Self>) {
        // SAFETY: nothing is moved.
        unsafe { self.get_unchecked_mut() }.phase = Phase::Listed;
    }

    #[inline(always)]
    unsafe fn meet(self: Pin<&mut Self>, partner: NonNull<WaitNode>) {
        // SAFETY: nothing is moved. By the contract the partner is a plain sender's node of this
        // channel, which holds its value; that of a new receive holds none.
        unsafe {
            let this = self.get_unchecked_mut();
            Waiter::put_value_of(this.node(), Waiter::take_value_of(partner.cast()));
            this.phase = Phase::Settled(Outcome::Done);
        }
    }

    #[inline(always)]
    unsafe fn output(self: Pin<&mut Self>) -> Self::Output {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        let outcome = this.outcome();
        this.settled(outcome)
    }
}
