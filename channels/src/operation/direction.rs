//! In what a send and a receive differ.

use super::{Node, Operation, Phase};
use crate::core::{Attempted, ChannelGuard};
use crate::end::End;
use crate::error::{Ended, RecvError, RecvTimeoutError, SendError, SendTimeoutError};
use crate::extended::{Mode, Noted, Releasing};
use crate::source::{InNode, Source};
use crate::wait_point::Lists;
use crate::waiter::{Begun, Make, Outcome, Waiter};
use core::cell::UnsafeCell;
use core::mem::{ManuallyDrop, MaybeUninit, needs_drop, take};
use core::ptr::NonNull;
use core::task::Context;

/// The direction of an [`Operation`]: [`Sending`](Sending) a value of some source, or
/// [`Receiving`](Receiving) one in some mode. Sealed: its module is private.
pub trait Direction<T>: Sized {
    /// What a successful operation returns.
    type Success<'a>
    where
        T: 'a;
    /// Why the channel let it fail.
    type Failure: Ended;
    /// What a new operation is made of: as small as can be, since it is moved until an alternative
    /// is polled.
    type Seed<'a>
    where
        T: 'a;

    /// The operation's name in messages.
    const NAME: &'static str;
    /// Whether it sends: all that the channel needs of a direction.
    const SEND: bool;
    /// Whether the fast path and hand-off slots can be used: the value moves from node to node, and
    /// no more is to be done.
    const PLAIN: bool;
    /// Whether an operation that has waited, and is done, has its result at once.
    const PLAIN_WHEN_MET: bool = Self::PLAIN;
    /// Whether it waits for an answer while it is held. An alternative in a failed branch does not
    /// fail by it, and it does not stay held in one.
    const ANSWERED: bool = false;
    /// Whether an operation that is over has anything to drop.
    const DROPS: bool = true;
    /// What makes a send's value when it is taken, if that does not lie in the node.
    const MAKE: Option<Make<T>> = None;
    /// How its node is begun to be listed.
    const BEGUN: Begun = Begun::InFull;

    /// Whether it can ever happen. Asked while it is new.
    #[inline(always)]
    fn is_open(&self) -> bool {
        true
    }

    /// It is about to wait, in the current process.
    #[inline(always)]
    fn waits(&mut self) {}

    /// Makes it happen at once, if possible: here a send. O(1).
    ///
    /// # Safety
    ///
    /// `node` is a new operation's, of the locked channel. With `cx`, it stays where it is until it
    /// is settled or withdrawn.
    #[inline]
    unsafe fn attempt<L: Lists>(
        node: NonNull<Node<T, Self>>,
        locked: &mut ChannelGuard<'_, T, L>,
        cx: Option<&Context<'_>>,
    ) -> Attempted {
        // SAFETY: the node is a new operation's, as is demanded here: it is in no queue, only its
        // future knows it, and by the operation's invariants it holds its value, or can make it. It
        // begins with its waiter. With `cx` it stays.
        unsafe { locked.send_now(node.cast(), Self::MAKE, cx) }
    }

    /// Takes the result of an operation that has communicated and is not
    /// [answered](Self::ANSWERED). Not a `Result`: that would cost each communication two
    /// instructions.
    ///
    /// # Safety
    ///
    /// The operation itself calls this, once, when it is over: it has communicated, and is in no
    /// queue.
    unsafe fn succeeded<'a>(operation: &mut Operation<'a, T, Self>) -> Self::Success<'a>;

    /// Takes the result of any operation that has communicated, so.
    ///
    /// # Safety
    ///
    /// As for [`succeeded`](Self::succeeded), of one with this outcome.
    unsafe fn communicated<'a>(
        operation: &mut Operation<'a, T, Self>,
        _: Outcome,
    ) -> Result<Self::Success<'a>, Self::Failure> {
        // SAFETY: it is over and has communicated, as is demanded here.
        Ok(unsafe { Self::succeeded(operation) })
    }

    /// Takes the failure of an operation that has failed.
    ///
    /// # Safety
    ///
    /// The operation itself calls this, once, when it is over: it has not communicated, and is in
    /// no queue.
    unsafe fn failed(operation: &mut Operation<'_, T, Self>, poisoned: bool) -> Self::Failure;

    /// What an operation returns in a replay that has met no partner before its channel closed,
    /// although the recorded one had. `None`: it fails.
    fn closed_later<'a>() -> Option<Result<Self::Success<'a>, Self::Failure>>
    where
        T: 'a;

    /// Drops what an operation with this outcome has left.
    ///
    /// # Safety
    ///
    /// The operation itself calls this, once, as it is dropped with this outcome: its result was
    /// not taken, and it is in no queue.
    unsafe fn dropped(operation: &mut Operation<'_, T, Self>, outcome: Outcome);

    /// Takes a new operation for its seed.
    fn into_seed<'a>(operation: Operation<'a, T, Self>) -> Self::Seed<'a>;

    /// Makes the operation that the seed was.
    fn from_seed<'a>(seed: Self::Seed<'a>) -> Operation<'a, T, Self>
    where
        T: 'a;
}

/// The direction of an operation that may give up.
pub trait GivesUp<T>: Direction<T> {
    /// Why it fails, if it may give up.
    type TimeoutFailure: Ended + From<Self::Failure>;

    /// Takes the failure of an operation that gives up.
    ///
    /// # Safety
    ///
    /// As for [`failed`](Direction::failed).
    unsafe fn timed_out(operation: &mut Operation<'_, T, Self>) -> Self::TimeoutFailure;
}

/// A send under way: see [`Sender::send`](crate::Sender::send). `S` is the source of its value.
pub type SendOp<'a, T, S = InNode> = Operation<'a, T, Sending<S>>;

/// The direction of a send, with the source of its value.
#[derive(Debug)]
pub struct Sending<S> {
    pub(crate) source: S,
}

impl<T, S: Source<T>> Direction<T> for Sending<S> {
    type Success<'a>
        = ()
    where
        T: 'a;
    type Failure = SendError<S::Unsent>;
    type Seed<'a>
        = SendOp<'a, T, S>
    where
        T: 'a;

    const NAME: &'static str = "send";
    const SEND: bool = true;
    const PLAIN: bool = S::MAKE.is_none();
    const PLAIN_WHEN_MET: bool = true;
    const MAKE: Option<Make<T>> = S::MAKE;

    #[inline(always)]
    fn is_open(&self) -> bool {
        self.source.is_open()
    }

    #[inline(always)]
    unsafe fn succeeded<'a>(_: &mut SendOp<'a, T, S>) {}

    unsafe fn failed(send: &mut SendOp<'_, T, S>, poisoned: bool) -> Self::Failure {
        SendError {
            // SAFETY: the send failed, as is demanded here, so the value is still here, and no
            // other thread knows the node any more.
            value: unsafe { S::unsent(send.node()) },
            poisoned,
        }
    }

    /// It was sent before the receivers went, but never received.
    fn closed_later<'a>() -> Option<Result<(), Self::Failure>>
    where
        T: 'a,
    {
        Some(Ok(()))
    }

    unsafe fn dropped(send: &mut SendOp<'_, T, S>, outcome: Outcome) {
        if !matches!(outcome, Outcome::Done | Outcome::Held) {
            // SAFETY: the value is still here, or the answer is, and no other thread knows the node
            // any more.
            drop(unsafe { S::unsent(send.node()) });
        }
    }

    #[inline]
    fn into_seed<'a>(send: SendOp<'a, T, S>) -> SendOp<'a, T, S> {
        send
    }

    #[inline]
    fn from_seed<'a>(seed: SendOp<'a, T, S>) -> SendOp<'a, T, S>
    where
        T: 'a,
    {
        seed
    }
}

impl<T, S: Source<T>> GivesUp<T> for Sending<S> {
    type TimeoutFailure = SendTimeoutError<S::Unsent>;

    unsafe fn timed_out(send: &mut SendOp<'_, T, S>) -> Self::TimeoutFailure {
        // SAFETY: the send has failed, as is demanded here.
        SendTimeoutError::Timeout(unsafe { Self::failed(send, false) }.value)
    }
}

impl<'a, T, S: Source<T>> SendOp<'a, T, S> {
    #[inline]
    pub(crate) fn sending(end: &'a End<T>, waiter: Waiter<T>, source: S) -> Self {
        Operation::of(end, waiter, Sending { source })
    }
}

impl<'a, T> SendOp<'a, T> {
    /// A send of `value`, which is written where it is to lie: to make the node first and move it
    /// would be to copy also what is not written before it is listed.
    #[inline(always)]
    pub(crate) fn of_value(end: &'a End<T>, value: T) -> Self {
        let mut send = MaybeUninit::<Self>::uninit();
        let place = send.as_mut_ptr();
        // SAFETY: the memory is this function's. Fields left unwritten may stay so: the node of a
        // send that is not listed.
        unsafe {
            (&raw mut (*place).end).write(end);
            let node = UnsafeCell::raw_get(&raw const (*place).node);
            Waiter::write_value(&raw mut (*node).waiter, value);
            (&raw mut (*place).phase).write(Phase::New);
            send.assume_init()
        }
    }
}

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
    unsafe fn attempt<L: Lists>(
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
            attempted => {
                if M::INHERITS {
                    // It may have taken calls off that are not waited for any more.
                    locked.boost_while_they_wait();
                }
                attempted
            }
        }
    }

    #[inline(always)]
    fn waits(&mut self) {
        M::waits(&mut self.note);
    }

    #[inline(always)]
    unsafe fn succeeded<'a>(receive: &mut RecvOp<'a, T, M>) -> M::Received<'a> {
        let ticket = receive.ticket();
        let note = take(&mut receive.node().direction.note);
        // SAFETY: a done receive holds its value, and no other thread knows the node any more.
        let value = unsafe { receive.take_value() };
        M::received(receive.end, value, ticket, note)
    }

    unsafe fn failed(_: &mut RecvOp<'_, T, M>, poisoned: bool) -> RecvError {
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

    unsafe fn dropped(receive: &mut RecvOp<'_, T, M>, outcome: Outcome) {
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

    unsafe fn timed_out(_: &mut RecvOp<'_, T, M>) -> RecvTimeoutError {
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
