//! The answering end.

use super::{Call, Message, Serving};
use crate::ended::Ended;
use crate::error::{RecvError, TryRecvError};
use crate::operation::RecvOp;
use crate::receiver::Receiver;
use crate::replay;
use core::fmt;
use luna_core::current;

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
        RecvOp::receiving(self.receiver.end())
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
        self.accept().at_once().map_err(TryRecvError::from)
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

    /// Waits until the clients are gone or the channel is poisoned, and accepts nothing: as
    /// [`Receiver::ended`].
    ///
    /// ```
    /// # use futures_lite::future::{block_on, zip};
    /// use luna_channels::ChannelEnd;
    /// let (client, server) = luna_channels::call_channel::<u32, u32>();
    /// let end = block_on(zip(server.ended(), async { drop(client) })).0;
    /// assert_eq!(end, ChannelEnd::Closed);
    /// ```
    pub fn ended(&self) -> Ended<'_> {
        self.receiver.ended()
    }

    /// Waits until the channel is poisoned, and accepts nothing: as [`Receiver::poisoned`].
    ///
    /// ```
    /// # use futures_lite::future::{block_on, zip};
    /// use luna_channels::ChannelEnd;
    /// let (client, server) = luna_channels::call_channel::<u32, u32>();
    /// let end = block_on(zip(server.poisoned(), async { client.poison() })).0;
    /// assert_eq!(end, ChannelEnd::Poisoned);
    /// ```
    pub fn poisoned(&self) -> Ended<'_> {
        self.receiver.poisoned()
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
pub type AcceptOp<'a, Q, A> = RecvOp<'a, Message<Q, A>, Serving>;
