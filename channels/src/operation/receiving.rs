//! A receive under way.

use super::{Direction, GivesUp, Node, Operation};
use crate::core::{Attempted, ChannelGuard};
use crate::end::End;
use crate::error::{RecvError, RecvTimeoutError};
use crate::extended::{Mode, Noted, Releasing};
use crate::wait_point::WaitQueues;
use crate::waiter::{Begun, Outcome, Waiter};
use core::mem::{ManuallyDrop, needs_drop, take};
use core::ops::DerefMut;
use core::ptr::NonNull;
use core::task::Context;

/// A receive under way: see [`Receiver::recv`](crate::Receiver::recv). `M` determines whether the
/// sender is held.
pub type RecvOp<'a, T, M = Releasing> = Operation<'a, T, Receiving<M>>;

/// The direction of a receive: the note of its mode.
#[derive(Debug)]
#[repr(transparent)]
pub struct Receiving<M: Noted> {
    pub(crate) note: M::Note,
}

impl<T, M: Mode<T>> Direction<T> for Receiving<M> {
    type Success<'a>
        = M::Received<'a>
    where
        T: 'a;
    type Failure = RecvError;
    type Seed<'a>
        = &'a End<T>
    where
        T: 'a;

    const NAME: &'static str = "receive";
    const SEND: bool = false;
    const PLAIN: bool = !M::HOLDS && !M::INHERITS;
    // The value that it may hold was taken, or never came.
    const DROPS: bool = needs_drop::<M::Note>();
    const BEGUN: Begun = match (M::HOLDS, M::INHERITS) {
        (_, true) => Begun::Serving,
        (true, false) => Begun::Holding,
        (false, false) => Begun::InFull,
    };

    #[inline]
    unsafe fn attempt<L: DerefMut<Target = WaitQueues>>(
        mut node: NonNull<Node<T, Self>>,
        locked: &mut ChannelGuard<'_, T, L>,
        _: Option<&Context<'_>>,
    ) -> Attempted {
        if M::INHERITS {
            locked.note_server();
        }
        // SAFETY: the node is a new operation's, as is demanded here: it is in no queue, only its
        // future knows it, and by the operation's invariants it holds no value.
        let attempted = unsafe { locked.recv_now(node.cast(), M::HOLDS) };
        match attempted {
            Attempted::Holds(sender) => {
                if M::INHERITS {
                    // Under the lock and in this order: a server that is between the two would not
                    // be as urgent as its client.
                    // SAFETY: a new receive's node is known to its future alone.
                    M::holds(unsafe { &mut node.as_mut().direction.note }, sender);
                    locked.boost_while_they_wait();
                }
                Attempted::DONE
            }
            attempted => attempted,
        }
    }

    #[inline(always)]
    fn waits(&mut self) {
        M::waits(&mut self.note);
    }

    #[inline(always)]
    fn succeeded<'a>(
        receive: &mut RecvOp<'a, T, M>,
        _: Outcome,
    ) -> Result<M::Received<'a>, RecvError> {
        let ticket = receive.ticket();
        let note = take(&mut receive.node().direction.note);
        // SAFETY: a done receive holds its value, and no other thread knows the node any more.
        let value = unsafe { receive.take_value() };
        Ok(M::received(receive.end, value, ticket, note))
    }

    fn failed(_: &mut RecvOp<'_, T, M>, poisoned: bool) -> RecvError {
        match poisoned {
            true => RecvError::Poisoned,
            false => RecvError::Closed,
        }
    }

    fn closed_later<'a>() -> Option<Result<M::Received<'a>, RecvError>>
    where
        T: 'a,
    {
        None
    }

    fn dropped(receive: &mut RecvOp<'_, T, M>, outcome: Outcome) {
        if outcome == Outcome::Done {
            let ticket = receive.ticket();
            // SAFETY: the value is here, and no other thread knows the node any more.
            let value = unsafe { receive.take_value() };
            M::return_value(receive.end, value, ticket);
        }
    }

    #[inline(always)]
    fn into_seed<'a>(receive: RecvOp<'a, T, M>) -> &'a End<T> {
        // A new one has nothing else, and nothing to drop.
        ManuallyDrop::new(receive).end
    }

    #[inline(always)]
    fn from_seed<'a>(seed: &'a End<T>) -> RecvOp<'a, T, M>
    where
        T: 'a,
    {
        RecvOp::receiving(seed)
    }
}

impl<T, M: Mode<T>> GivesUp<T> for Receiving<M> {
    type TimeoutFailure = RecvTimeoutError;

    fn timed_out(_: &mut RecvOp<'_, T, M>) -> RecvTimeoutError {
        RecvTimeoutError::Timeout
    }
}

impl<'a, T, M: Mode<T>> RecvOp<'a, T, M> {
    #[inline]
    pub(crate) fn receiving(end: &'a End<T>) -> Self {
        let note = M::Note::default();
        Operation::of(end, Waiter::empty(), Receiving { note })
    }

    /// Number of the extended rendezvous of a receive that is done; 0 if no sender is held.
    #[inline(always)]
    fn ticket(&self) -> u32 {
        match M::HOLDS {
            // SAFETY: a done receive's node is known to its future alone. What completed the
            // receive has written the field.
            true => unsafe { (*Waiter::link(self.waiter())).ticket },
            false => 0,
        }
    }
}
