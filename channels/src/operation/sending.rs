//! A send under way.

use super::{Direction, GivesUp, Operation, Phase};
use crate::end::End;
use crate::error::{SendError, SendTimeoutError};
use crate::source::{InNode, Source};
use crate::waiter::{Make, Outcome, Waiter};
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

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
    fn succeeded<'a>(_: &mut SendOp<'a, T, S>, _: Outcome) -> Result<(), Self::Failure> {
        Ok(())
    }

    fn failed(send: &mut SendOp<'_, T, S>, poisoned: bool) -> Self::Failure {
        SendError {
            // SAFETY: the send failed, so the value is still here, and no other thread knows the
            // node any more.
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

    fn dropped(send: &mut SendOp<'_, T, S>, outcome: Outcome) {
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

    fn timed_out(send: &mut SendOp<'_, T, S>) -> Self::TimeoutFailure {
        SendTimeoutError::Timeout(Self::failed(send, false).value)
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
