//! The calling end.

use super::{CallError, Message};
use crate::ended::Ended;
use crate::operation::{Direction, Operation};
use crate::sender::Sender;
use crate::waiter::{Outcome, Waiter};
use core::fmt;

/// The calling end of a [`call_channel`](crate::call_channel). Any number of clones, on any
/// threads, may call at the same time.
///
/// Dropping the last one closes the channel: calls that were accepted are still answered, then
/// servers get [`RecvError::Closed`](crate::RecvError::Closed). Cloning is not for the real-time
/// path; dropping is O(1), and O(waiting servers) for the last one.
pub struct Client<Q, A> {
    sender: Sender<Message<Q, A>>,
}

impl<Q, A> Client<Q, A> {
    pub(super) fn new(sender: Sender<Message<Q, A>>) -> Self {
        Self { sender }
    }

    /// Sends `request` and waits for the reply. Works as a guard of an alternative, which chooses
    /// it when a server takes the request, and is over with the reply: a delay beside it bounds the
    /// wait for a server, not for the reply. To bound both, drop the future (a race with
    /// [`after`](crate::after)): that is safe.
    ///
    /// Of several that wait the one of highest priority is served first, of equal ones the one that
    /// came first. While it waits and while it is served, the server inherits the caller's priority
    /// as it was when the call was first polled: see [`Server`](crate::Server). Real-time path:
    /// yes; no allocation, O(1), O(waiting clients of lower priority) to wait, and a system call
    /// where a server on a thread of lower OS priority inherits, and one to withdraw then.
    ///
    /// Cancel-safe: a future that is dropped before a server has taken the request leaves no trace.
    /// After that the server keeps the request, and its reply comes back to it.
    ///
    /// # Errors
    ///
    /// [`CallError`]: with the request, if no server has taken it.
    ///
    /// ```
    /// # use futures_lite::future::{block_on, zip};
    /// let (client, server) = luna_channels::call_channel::<u32, u32>();
    /// let serve = async { server.accept().await.map(drop) }; // no reply
    /// let answer = block_on(zip(client.call(5), serve)).0;
    /// assert!(answer.unwrap_err().is_unanswered());
    /// ```
    #[inline]
    pub fn call(&self, request: Q) -> CallOp<'_, Q, A> {
        let request = Waiter::with_value(Message::Request(request));
        Operation::of(self.sender.end(), request, Calling)
    }

    /// Like [`call`](Self::call), blocking this thread. For plain threads and OS-thread processes.
    ///
    /// # Errors
    ///
    /// As for `call`.
    ///
    /// # Panics
    ///
    /// In a process of an executor, which it would stop.
    ///
    /// ```
    /// let (client, server) = luna_channels::call_channel::<u32, u32>();
    /// let thread = std::thread::spawn(move || {
    ///     while let Ok(call) = server.blocking_accept() {
    ///         let answer = *call + 1;
    ///         let _ = call.reply(answer); // the client may have gone
    ///     }
    /// });
    /// assert_eq!(client.blocking_call(1).unwrap(), 2);
    /// drop(client);
    /// thread.join().unwrap();
    /// ```
    #[cfg(not(loom))]
    #[track_caller]
    pub fn blocking_call(&self, request: Q) -> Result<A, CallError<Q>> {
        luna_core::park::block_on(self.call(request))
    }

    /// Poisons the channel: all calls and accepts that wait, and all that come to it later, fail as
    /// poisoned; so do calls that were accepted and not answered. May be called more than once.
    /// Real-time path: yes; O(waiting operations).
    ///
    /// ```
    /// let (client, server) = luna_channels::call_channel::<u32, u32>();
    /// client.poison();
    /// assert!(server.blocking_accept().unwrap_err().is_poisoned());
    /// assert!(client.blocking_call(1).unwrap_err().is_poisoned());
    /// ```
    pub fn poison(&self) {
        self.sender.poison();
    }

    /// Waits until no call can be served any more: as [`Sender::ended`].
    ///
    /// ```
    /// # use futures_lite::future::{block_on, zip};
    /// use luna_channels::ChannelEnd;
    /// let (client, server) = luna_channels::call_channel::<u32, u32>();
    /// let end = block_on(zip(client.ended(), async { drop(server) })).0;
    /// assert_eq!(end, ChannelEnd::Closed);
    /// ```
    pub fn ended(&self) -> Ended<'_> {
        self.sender.ended()
    }

    /// Names the channel in reports: see [`inspect`](crate::inspect). Not for the real-time path.
    ///
    /// ```
    /// let (client, _server) = luna_channels::call_channel::<u32, u32>();
    /// let _client = client.named("gripper");
    /// assert!(luna_channels::inspect::wait_points().iter().any(|point| point.name.as_deref() == Some("gripper")));
    /// ```
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        Self::new(self.sender.named(name))
    }

    /// Declares that a user of the channel is outside of the system: see [`Sender::external`].
    ///
    /// ```
    /// let (client, _server) = luna_channels::call_channel::<u32, u32>();
    /// let _client = client.external().named("from outside");
    /// let points = luna_channels::inspect::wait_points();
    /// assert!(points.iter().any(|point| point.external && point.name.as_deref() == Some("from outside")));
    /// ```
    #[must_use]
    pub fn external(self) -> Self {
        Self::new(self.sender.external())
    }
}

impl<Q, A> Clone for Client<Q, A> {
    fn clone(&self) -> Self {
        Self::new(self.sender.clone())
    }
}

impl<Q, A> fmt::Debug for Client<Q, A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Client").field(&self.sender).finish()
    }
}

/// A call under way: see [`Client::call`]. A send whose node takes the reply.
pub type CallOp<'a, Q, A> = Operation<'a, Message<Q, A>, Calling>;

/// The direction of a call.
#[derive(Debug)]
pub struct Calling;

impl<Q, A> Direction<Message<Q, A>> for Calling {
    type Success<'a>
        = A
    where
        Q: 'a,
        A: 'a;
    type Failure = CallError<Q>;
    type Seed<'a>
        = CallOp<'a, Q, A>
    where
        Q: 'a,
        A: 'a;

    const NAME: &'static str = "call";
    const SEND: bool = true;
    // Servers hold their clients.
    const PLAIN: bool = false;
    const ANSWERED: bool = true;

    unsafe fn succeeded<'a>(_: &mut CallOp<'a, Q, A>) -> A {
        unreachable!("a call is answered")
    }

    unsafe fn communicated<'a>(
        call: &mut CallOp<'a, Q, A>,
        outcome: Outcome,
    ) -> Result<A, CallError<Q>> {
        match outcome {
            // SAFETY: an answered node holds a value, and no other thread knows it.
            Outcome::Answered => match unsafe { call.take_value() } {
                Message::Answer(answer) => Ok(answer),
                _ => Err(CallError::Unanswered),
            },
            // Its branch has failed while the server had the request.
            Outcome::Held => Err(CallError::Interrupted),
            _ if call.channel().is_poisoned() => Err(CallError::Interrupted),
            // A call that was forgotten until the last server went.
            _ => Err(CallError::Unanswered),
        }
    }

    unsafe fn failed(call: &mut CallOp<'_, Q, A>, poisoned: bool) -> CallError<Q> {
        // SAFETY: the call failed, so its request is still here, and no other thread knows the node
        // any more.
        match (unsafe { call.take_value() }, poisoned) {
            (Message::Request(request), true) => CallError::Poisoned(request),
            (Message::Request(request), false) => CallError::Closed(request),
            // What a call offers is a request.
            _ => CallError::Unanswered,
        }
    }

    /// It was sent before the servers went, but never received.
    fn closed_later<'a>() -> Option<Result<A, CallError<Q>>>
    where
        Q: 'a,
        A: 'a,
    {
        Some(Err(CallError::Unanswered))
    }

    unsafe fn dropped(call: &mut CallOp<'_, Q, A>, outcome: Outcome) {
        if !matches!(outcome, Outcome::Done | Outcome::Held) {
            // SAFETY: the request is still here, or the answer is, and no other thread knows the
            // node any more.
            drop(unsafe { call.take_value() });
        }
    }

    #[inline]
    fn into_seed<'a>(call: CallOp<'a, Q, A>) -> CallOp<'a, Q, A> {
        call
    }

    #[inline]
    fn from_seed<'a>(seed: CallOp<'a, Q, A>) -> CallOp<'a, Q, A>
    where
        Q: 'a,
        A: 'a,
    {
        seed
    }
}
