//! A call that was accepted, and what can go wrong with one.

use super::Message;
use crate::end::End;
use crate::error::Ended;
use crate::waiter::{Outcome, Waiter};
use core::fmt;
use core::ops::{Deref, DerefMut};
use luna_core::current::Inheritor;
use thiserror::Error;

/// A call that was accepted: the request, and the duty to reply. Dropped without a reply, its
/// client's call fails as [`Unanswered`](crate::CallError::Unanswered).
///
/// It may be kept, and be moved to another process or thread to be answered there; the process that
/// accepted it inherits the client's priority until then. A forgotten call holds its client until
/// the channel ends, and the boost stays. Dropping it is for the real-time path: O(calls that are
/// accepted and not answered on this channel), and a system call if a thread's OS priority is set
/// back.
///
/// ```
/// # use futures_lite::future::{block_on, zip};
/// let (client, server) = luna_channels::call_channel::<Vec<u32>, Vec<u32>>();
/// let serve = async {
///     let mut call = server.accept().await.unwrap();
///     call.push(4);
///     let (numbers, reply) = call.into_parts(); // to move the request out
///     reply.send(numbers).expect("the client waits");
/// };
/// assert_eq!(block_on(zip(client.call(vec![3]), serve)).0.unwrap(), [3, 4]);
/// ```
#[must_use = "the client gets no reply when this is dropped"]
pub struct Call<'a, Q, A> {
    request: Q,
    reply: Reply<'a, Q, A>,
}

impl<'a, Q, A> Call<'a, Q, A> {
    /// A call, with its client held by `ticket`.
    pub(super) fn accepted(
        end: &'a End<Message<Q, A>>,
        message: Message<Q, A>,
        ticket: u32,
        inheritor: Option<Inheritor>,
    ) -> Self {
        // The boost was begun under the channel's lock, where the system may have refused it.
        if let Some(inheritor) = &inheritor {
            inheritor.catch_up();
        }
        let reply = Reply {
            end,
            ticket,
            inheritor,
        };
        let Message::Request(request) = message else {
            unreachable!("what a client offers is a request")
        };
        Call { request, reply }
    }

    /// Lets the client go on with `answer`; the priority that was inherited from it is given back
    /// then, and the request is dropped last. Real-time path: as for dropping it. A reply is no
    /// scheduling point: the client runs at the next await, if it shares the executor.
    ///
    /// # Errors
    ///
    /// Gives the answer back when the client has gone, or the channel was poisoned meanwhile.
    ///
    /// ```
    /// let (client, server) = luna_channels::call_channel::<u32, u32>();
    /// let mut call = Box::pin(client.call(1));
    /// # let cx = &mut std::task::Context::from_waker(std::task::Waker::noop());
    /// assert!(call.as_mut().poll(cx).is_pending());
    /// let accepted = server.try_accept()?;
    /// drop(call); // the client does not want it any more
    /// assert_eq!(accepted.reply(2), Err(2));
    /// # Ok::<(), luna_channels::TryRecvError>(())
    /// ```
    pub fn reply(self, answer: A) -> Result<(), A> {
        let Call { request, reply } = self;
        let replied = reply.send(answer);
        drop(request);
        replied
    }

    /// The request, and what replies to it.
    pub fn into_parts(self) -> (Q, Reply<'a, Q, A>) {
        (self.request, self.reply)
    }
}

impl<Q, A> Deref for Call<'_, Q, A> {
    type Target = Q;
    fn deref(&self) -> &Q {
        &self.request
    }
}

impl<Q, A> DerefMut for Call<'_, Q, A> {
    fn deref_mut(&mut self) -> &mut Q {
        &mut self.request
    }
}

impl<Q: fmt::Debug, A> fmt::Debug for Call<'_, Q, A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Call").field(&self.request).finish()
    }
}

/// The duty to reply to a call, without its request: see [`Call::into_parts`]. All statements about
/// [`Call`] hold for it.
///
/// # Invariants
///
/// `ticket` is that of the client, as long as it was not let go; then 0. Ticket 0 holds no client.
#[must_use = "the client gets no reply when this is dropped"]
pub struct Reply<'a, Q, A> {
    end: &'a End<Message<Q, A>>,
    ticket: u32,
    /// Gives the boost back after the client was woken: before, other processes could run in
    /// between.
    inheritor: Option<Inheritor>,
}

impl<Q, A> Reply<'_, Q, A> {
    /// As [`Call::reply`].
    ///
    /// # Errors
    ///
    /// As for `Call::reply`.
    pub fn send(mut self, answer: A) -> Result<(), A> {
        match self.finish(Message::Answer(answer)) {
            Some(Message::Answer(answer)) => Err(answer),
            _ => Ok(()),
        }
    }

    /// Lets the client go on with `message`; gives it back if the client has gone.
    fn finish(&mut self, message: Message<Q, A>) -> Option<Message<Q, A>> {
        let mut message = Some(message);
        let ticket = core::mem::take(&mut self.ticket);
        self.end.channel().finish_held(ticket, |client| {
            if let Some(message) = message.take() {
                // SAFETY: a held sender's node holds no value; the lock is held.
                unsafe { Waiter::put_value_of(client, message) };
            }
            Outcome::Answered
        });
        message
    }
}

impl<Q, A> Drop for Reply<'_, Q, A> {
    fn drop(&mut self) {
        self.finish(Message::NoAnswer);
    }
}

luna_platform::debug_fields!(
    impl[Q, A] Reply<'_, Q, A>, |reply|
    ticket: reply.ticket,
    inheritor: reply.inheritor
);

/// A call failed. A request that no server has taken is given back.
///
/// ```
/// let (client, server) = luna_channels::call_channel::<u32, ()>();
/// drop(server);
/// let error = client.blocking_call(7).unwrap_err();
/// assert!(error.is_closed());
/// assert_eq!(error.into_request(), Some(7));
/// ```
#[derive(Clone, PartialEq, Eq, Error)]
pub enum CallError<Q> {
    /// The last server is gone, and did not take the request.
    #[error("calling on a channel whose last server is gone")]
    Closed(Q),
    /// The channel, or the branch that called, was poisoned before a server took the request.
    #[error("calling on a poisoned channel")]
    Poisoned(Q),
    /// A server took the request and did not reply: it has dropped the call, or panicked.
    #[error(
        "the server has dropped the call without a reply: it has ended or panicked, or does not reply to all"
    )]
    Unanswered,
    /// A server took the request, and the channel, or the branch that called, was poisoned before
    /// the reply.
    #[error("the channel was poisoned before the server replied")]
    Interrupted,
}

impl<Q> CallError<Q> {
    /// The request, if no server has taken it.
    pub fn into_request(self) -> Option<Q> {
        match self {
            CallError::Closed(request) | CallError::Poisoned(request) => Some(request),
            CallError::Unanswered | CallError::Interrupted => None,
        }
    }

    /// Whether the last server is gone.
    pub fn is_closed(&self) -> bool {
        matches!(self, CallError::Closed(_))
    }

    /// Whether the channel, or the branch that called, was poisoned.
    pub fn is_poisoned(&self) -> bool {
        matches!(self, CallError::Poisoned(_) | CallError::Interrupted)
    }

    /// Whether a server has dropped the call.
    pub fn is_unanswered(&self) -> bool {
        matches!(self, CallError::Unanswered)
    }
}

impl<Q> Ended for CallError<Q> {
    fn poisoned(&self) -> Option<bool> {
        Some(self.is_poisoned())
    }

    fn has_communicated(&self) -> bool {
        matches!(self, CallError::Unanswered | CallError::Interrupted)
    }
}

// Without the request, so that it need not be `Debug`.
luna_platform::debug_fields!(impl[Q] CallError<Q>, |error| reason: format_args!("{error}"));
