//! The answering end.

use super::serving::Serving;
use super::{Call, Message};
use crate::alternative::{Attempt, Guard, RawGuard, Terms};
use crate::core::{Ending, Received};
use crate::error::{RecvError, TryRecvError};
use crate::extended::Mode;
use crate::recv::{Receiver, RecvOp};
use crate::replay;
use crate::select_state::SelectState;
use crate::wait_point::WaitQueues;
use luna_core::current;
use std::fmt;
use std::future::Future;
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll};

/// The answering end of a [`call_channel`](crate::call_channel). Any number of clones, on any
/// threads, may accept at the same time; each call goes to one. One server may have accepted
/// several calls, and answers them in any order.
///
/// # Priority
///
/// From the moment when a call is handed to a server until its [`reply`](Call::reply), or until the
/// [`Call`] is dropped, the process that accepted it runs at the client's priority, if that is
/// above its own; with several calls, at the highest. Compared is the OS priority first, then the
/// level:
///
/// - A client of the same OS priority and a higher level raises the server's level on its executor,
///   also before the server is woken.
/// - A client of a higher OS priority raises the server to the highest level of its executor and
///   boosts the executor's OS thread to that priority (`sched_setscheduler`), which is set back
///   with the reply. The processes that share the executor run at that priority too when the server
///   waits. Where the system refuses, the server works at its own OS priority, and
///   `luna_core::current::refused_boosts` counts it.
/// - A client outside of any process has the lowest priority, and a server outside inherits
///   nothing.
///
/// It is passed on: a server that calls another one calls at the priority that it has inherited.
///
/// A client that waits for an `accept` boosts the process that last came to accept in the same way,
/// be it busy with another call or on its way back. That process is known from its first `accept`
/// on, also from a dropped one, and until another process accepts. It inherits the priority of the
/// most urgent waiting client, until none waits. Not inherited: by a server that never accepted; by
/// several servers that are all busy, but for the last; and a server's boost is not passed on while
/// it waits itself, for a reply of another server or for a mutex.
///
/// Dropping the last one closes the channel: clients get their requests back. Cloning is not for
/// the real-time path; dropping is O(1), and O(waiting clients) for the last one.
pub struct Server<Q, A> {
    receiver: Receiver<Message<Q, A>>,
}

impl<Q, A> Server<Q, A> {
    pub(super) fn new(receiver: Receiver<Message<Q, A>>) -> Self {
        Self { receiver }
    }

    /// Waits for a call. Works as a guard of an alternative.
    ///
    /// Of several servers that wait the one of highest priority gets it, of equal ones the one that
    /// came first. Cancel-safe: a future that is dropped while it waits leaves no trace; one that
    /// is dropped when it was given a call hands it to the next server, or lets its client wait
    /// again, before those of its priority. Real-time path: yes; no allocation, O(1), O(waiting
    /// servers of lower priority) to wait, and a system call if this thread inherits an OS
    /// priority.
    ///
    /// # Errors
    ///
    /// [`RecvError`]: the last client is gone, or the channel is poisoned.
    ///
    /// ```
    /// # use futures_lite::future::{block_on, zip};
    /// let (client, server) = luna_channels::call_channel::<&str, usize>();
    /// let serve = async {
    ///     while let Ok(call) = server.accept().await {
    ///         let length = call.len();
    ///         let _ = call.reply(length); // the client may have gone
    ///     }
    /// };
    /// let work = async {
    ///     assert_eq!(client.call("three").await, Ok(5));
    ///     assert_eq!(client.call("").await, Ok(0));
    ///     drop(client);
    /// };
    /// block_on(zip(serve, work));
    /// ```
    #[inline]
    pub fn accept(&self) -> AcceptOp<'_, Q, A> {
        AcceptOp {
            recv: RecvOp::new(&self.receiver),
        }
    }

    /// Accepts a call at once: only if a client waits. The real-time path may call it; O(1).
    ///
    /// # Errors
    ///
    /// [`TryRecvError`].
    ///
    /// ```
    /// let (client, server) = luna_channels::call_channel::<u32, u32>();
    /// assert!(server.try_accept().unwrap_err().is_empty());
    /// drop(client);
    /// assert!(server.try_accept().unwrap_err().is_closed());
    /// ```
    pub fn try_accept(&self) -> Result<Call<'_, Q, A>, TryRecvError> {
        if current::has_replay_log() {
            replay::outside("`try_accept`");
        }
        let mut locked = self.receiver.channel().lock();
        locked.note_server();
        let received = locked.recv_now(true);
        let mut inheritor = None;
        if let Received::Done(_, _, holding) = &received {
            Serving::holds(&mut inheritor, holding.priority);
            locked.boost_while_they_wait();
        }
        locked.release();
        match received {
            Received::Done(value, ready, holding) => {
                // Before the client's waker can panic: then the call is dropped without a reply.
                let accepted = Serving::received(&self.receiver, value, holding.ticket, inheritor);
                let call = Call::of(accepted);
                ready.wake();
                Ok(call)
            }
            Received::Empty => Err(TryRecvError::Empty),
            Received::Ended(Ending::Poisoned) => Err(TryRecvError::Poisoned),
            Received::Ended(_) => Err(TryRecvError::Closed),
            // A request is never made when it is taken.
            Received::Broken(ready) => {
                ready.wake();
                Err(TryRecvError::Poisoned)
            }
        }
    }

    /// Like [`accept`](Self::accept), blocking this thread. For plain threads and OS-thread
    /// processes.
    ///
    /// # Errors
    ///
    /// As for `accept`.
    ///
    /// # Panics
    ///
    /// In a process of an executor, which it would stop.
    ///
    /// ```
    /// let (client, server) = luna_channels::call_channel::<u32, u32>();
    /// drop(client);
    /// assert!(server.blocking_accept().unwrap_err().is_closed());
    /// ```
    #[cfg(not(loom))]
    #[track_caller]
    pub fn blocking_accept(&self) -> Result<Call<'_, Q, A>, RecvError> {
        luna_core::park::block_on(self.accept())
    }

    /// Poisons the channel: see [`Client::poison`](crate::Client::poison). A reply to a call that
    /// was accepted before comes back.
    ///
    /// ```
    /// let (client, server) = luna_channels::call_channel::<u32, u32>();
    /// server.poison();
    /// assert!(client.blocking_call(1).unwrap_err().is_poisoned());
    /// ```
    pub fn poison(&self) {
        self.receiver.poison();
    }

    /// Names the channel in reports: see [`inspect`](crate::inspect). Not for the real-time path.
    ///
    /// ```
    /// let (_client, server) = luna_channels::call_channel::<u32, u32>();
    /// let _server = server.named("arm");
    /// assert!(luna_channels::inspect::wait_points().iter().any(|point| point.name.as_deref() == Some("arm")));
    /// ```
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        Self::new(self.receiver.named(name))
    }

    /// Declares that a user of the channel is outside of the system: see
    /// [`Sender::external`](crate::Sender::external).
    ///
    /// ```
    /// let (_client, server) = luna_channels::call_channel::<u32, u32>();
    /// let _server = server.external().named("panel");
    /// let points = luna_channels::inspect::wait_points();
    /// assert!(points.iter().any(|point| point.external && point.name.as_deref() == Some("panel")));
    /// ```
    #[must_use]
    pub fn external(self) -> Self {
        Self::new(self.receiver.external())
    }
}

impl<Q, A> Clone for Server<Q, A> {
    fn clone(&self) -> Self {
        Self::new(self.receiver.clone())
    }
}

impl<Q, A> fmt::Debug for Server<Q, A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Server").field(&self.receiver).finish()
    }
}

/// An accept under way: see [`Server::accept`].
#[must_use = "an operation does nothing unless awaited or offered in an alternative"]
pub struct AcceptOp<'a, Q, A> {
    recv: RecvOp<'a, Message<Q, A>, Serving>,
}

impl<'a, Q, A> AcceptOp<'a, Q, A> {
    #[inline]
    fn recv(self: Pin<&mut Self>) -> Pin<&mut RecvOp<'a, Message<Q, A>, Serving>> {
        // SAFETY: the receive is pinned with the whole.
        unsafe { self.map_unchecked_mut(|this| &mut this.recv) }
    }
}

impl<'a, Q, A> Future for AcceptOp<'a, Q, A> {
    type Output = Result<Call<'a, Q, A>, RecvError>;

    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        self.recv().poll(cx).map(|accepted| accepted.map(Call::of))
    }
}

impl<Q, A> RawGuard for AcceptOp<'_, Q, A> {
    fn terms(&self) -> Terms<'_> {
        Terms {
            can_fail: false,
            ..self.recv.terms()
        }
    }

    unsafe fn attempt(
        self: Pin<&mut Self>,
        lists: Option<&mut WaitQueues>,
        cx: &mut Context<'_>,
    ) -> Attempt {
        // SAFETY: the contract is the same.
        unsafe { self.recv().attempt(lists, cx) }
    }

    unsafe fn list(
        self: Pin<&mut Self>,
        lists: &mut WaitQueues,
        select_state: NonNull<SelectState>,
        guard: u32,
    ) {
        // SAFETY: the contract is the same.
        unsafe { self.recv().list(lists, select_state, guard) };
    }

    unsafe fn withdraw(self: Pin<&mut Self>) {
        // SAFETY: the contract: it is the guard within this one.
        unsafe { self.recv().withdraw() };
    }

    unsafe fn poll_chosen(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        // SAFETY: the contract: it is the guard within this one.
        unsafe { self.recv().poll_chosen(cx) }
    }

    fn note_logged(&self) {
        self.recv.note_logged();
    }

    fn order(&self) -> u64 {
        RawGuard::order(&self.recv)
    }

    unsafe fn fail(self: Pin<&mut Self>) -> bool {
        // SAFETY: the contract: it is the guard within this one.
        unsafe { self.recv().fail() }
    }
}

impl<'a, Q, A> Guard for AcceptOp<'a, Q, A> {
    type Output = Result<Call<'a, Q, A>, RecvError>;
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
        // SAFETY: the contract: it is the guard within this one.
        unsafe { self.recv().output() }.map(Call::of)
    }
}

impl<Q, A> fmt::Debug for AcceptOp<'_, Q, A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("AcceptOp").field(&self.recv).finish()
    }
}
