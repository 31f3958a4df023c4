//! The calling end.

use super::{CallError, Message};
use crate::alternative::{Attempt, Guard, RawGuard, Terms, own_seed};
use crate::ended::Ended;
use crate::error::SendError;
use crate::operation::SendOp;
use crate::select_state::SelectState;
use crate::sender::Sender;
use crate::wait_point::{Ending, WaitQueues};
use core::fmt;
use core::future::Future;
use core::pin::Pin;
use core::ptr::NonNull;
use core::task::{Context, Poll};
use luna_core::current;
use pin_project_lite::pin_project;

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
        CallOp {
            send: self.sender.send(Message::Request(request)),
            sender: &self.sender,
            interrupted: false,
        }
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

pin_project! {
    /// A call under way: see [`Client::call`].
    #[must_use = "an operation does nothing unless awaited or offered in an alternative"]
    pub struct CallOp<'a, Q, A> {
        #[pin]
        send: SendOp<'a, Message<Q, A>>,
        sender: &'a Sender<Message<Q, A>>,
        // The branch that called has failed while the server had the request.
        interrupted: bool,
    }
}

impl<'a, Q, A> CallOp<'a, Q, A> {
    #[inline]
    fn send(self: Pin<&mut Self>) -> Pin<&mut SendOp<'a, Message<Q, A>>> {
        self.project().send
    }

    /// What a send that is over means.
    fn result(
        mut self: Pin<&mut Self>,
        sent: Result<(), SendError<Message<Q, A>>>,
    ) -> Result<A, CallError<Q>> {
        match sent {
            Ok(()) => match self.as_mut().send().take_answer() {
                Some(Message::Answer(answer)) => Ok(answer),
                Some(_) => Err(CallError::Unanswered),
                None if self.interrupted || self.is_poisoned() => Err(CallError::Interrupted),
                // A call that was forgotten until the last server went.
                None => Err(CallError::Unanswered),
            },
            Err(SendError {
                value: Message::Request(request),
                poisoned,
            }) => Err(if poisoned {
                CallError::Poisoned(request)
            } else {
                CallError::Closed(request)
            }),
            // What a call offers is a request.
            Err(_) => Err(CallError::Unanswered),
        }
    }

    fn is_poisoned(&self) -> bool {
        self.sender.end().channel().wait_point().lock().ending == Ending::Poisoned
    }

    /// A failed branch does not wait for a server: its reply goes nowhere.
    fn interrupt(mut self: Pin<&mut Self>) {
        current::stay_in_branch();
        self.as_mut().send().abandon();
        *self.project().interrupted = true;
    }
}

impl<Q, A> Future for CallOp<'_, Q, A> {
    type Output = Result<A, CallError<Q>>;

    #[inline]
    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let sent = match self.as_mut().send().poll(cx) {
            Poll::Ready(sent) => sent,
            Poll::Pending if current::branch_failed() && !self.send.lets_others_run() => {
                self.as_mut().interrupt();
                // SAFETY: it has just been settled, and is not polled again.
                unsafe { self.as_mut().send().output() }
            }
            Poll::Pending => return Poll::Pending,
        };
        Poll::Ready(self.result(sent))
    }
}

// SAFETY: the send within it borrows the end that keeps the wait point of these terms, and its
// drop, with that of the call, takes its node off.
unsafe impl<Q, A> RawGuard for CallOp<'_, Q, A> {
    fn terms(&self) -> Terms {
        Terms {
            plain: None,
            can_fail: false,
            ..self.send.terms()
        }
    }

    unsafe fn attempt(
        self: Pin<&mut Self>,
        lists: Option<&mut WaitQueues>,
        cx: &mut Context<'_>,
    ) -> Attempt {
        // SAFETY: the lists are those of this guard's wait point, which is the send's, and a new
        // call has a new send: as is demanded here.
        unsafe { self.send().attempt(lists, cx) }
    }

    unsafe fn list(
        self: Pin<&mut Self>,
        lists: &mut WaitQueues,
        select_state: NonNull<SelectState>,
        guard: u32,
    ) {
        // SAFETY: the lists are those of this guard's wait point, which is the send's; a new call
        // has a new send; and the select state outlives its being listed: as is demanded here.
        unsafe { self.send().list(lists, select_state, guard) };
    }

    unsafe fn withdraw(self: Pin<&mut Self>) {
        // SAFETY: the call's alternative calls this, and so the send's; a send within a call is not
        // polled before the call is.
        unsafe { self.send().withdraw() };
    }

    unsafe fn poll_chosen(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        // SAFETY: the call's alternative calls this, and so the send's, which is chosen when the
        // call is; it was not polled, since the call was not.
        let polled = unsafe { self.as_mut().send().poll_chosen(cx) };
        if polled.is_pending() && current::branch_failed() {
            self.interrupt();
            return Poll::Ready(());
        }
        polled
    }

    fn released(&self) {
        self.send.released();
    }

    fn note_logged(&self) {
        self.send.note_logged();
    }

    fn order(&self) -> u64 {
        RawGuard::order(&self.send)
    }

    unsafe fn fail(self: Pin<&mut Self>) -> bool {
        // SAFETY: the call's alternative calls this, and so the send's. The send was not polled,
        // and is listed nowhere, since that holds of the call.
        unsafe { self.send().fail() }
    }
}

impl<Q, A> Guard for CallOp<'_, Q, A> {
    type Output = Result<A, CallError<Q>>;

    own_seed!();

    unsafe fn output(mut self: Pin<&mut Self>) -> Self::Output {
        // SAFETY: the call was chosen and is over, so the send is, or was settled by `interrupt`.
        // This is called once, as is demanded here.
        let sent = unsafe { self.as_mut().send().output() };
        self.result(sent)
    }
}

impl<Q, A> fmt::Debug for CallOp<'_, Q, A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("CallOp").field(&self.send).finish()
    }
}
