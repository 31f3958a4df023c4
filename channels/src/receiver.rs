//! The end of a channel for receiving.

use crate::core::Channel;
use crate::end::End;
use crate::ended::Ended;
use crate::error::{RecvError, RecvTimeoutError, TryRecvError};
use crate::extended::Extending;
use crate::operation::{RecvOp, RecvTimeout};
use crate::stream::Incoming;
use alloc::boxed::Box;
use core::fmt;
use core::future::Future;
use core::ptr::NonNull;
use core::time::Duration;
use futures_core::Stream;
use futures_lite::{StreamExt, stream};
use luna_core::timer_queue::Sleep;
use luna_platform::clock::Instant;

/// The receiving end of a channel. Any number of clones, on any threads, may receive at the same
/// time; each value goes to one.
///
/// Dropping the last one closes the channel: senders get their values back, and what is buffered is
/// dropped. Cloning is not for the real-time path; dropping is O(1), and O(waiting senders +
/// buffered values) for the last one.
pub struct Receiver<T>(End<T>);

impl<T> Receiver<T> {
    /// # Safety
    ///
    /// The caller gives this one of the receivers that the channel counts.
    pub(crate) unsafe fn new(channel: NonNull<Channel<T>>) -> Self {
        // SAFETY: the caller gives this a receiver that the channel counts, as is demanded here: so
        // the end keeps the channel.
        Self(unsafe { End::new(channel) })
    }

    #[inline]
    pub(crate) fn end(&self) -> &End<T> {
        &self.0
    }

    pub(crate) fn channel(&self) -> &Channel<T> {
        self.0.channel()
    }

    /// Waits for a value.
    ///
    /// Of several that wait the one of highest priority gets it, of equal ones the one that came
    /// first. Fails when the last sender is gone and nothing is left, or when the channel is
    /// poisoned. Cancel-safe: a future that is dropped while it waits leaves no trace; one that is
    /// dropped after it was given a value puts it back at the head of the channel. One that need
    /// not wait is a scheduling point all the same, be it that it succeeds or fails: more urgent
    /// processes of its executor run first, and after many in one go, all. Real-time path: yes; no
    /// allocation, O(1), and O(waiting receivers of lower priority) to wait.
    ///
    /// ```
    /// # use futures_lite::future::block_on;
    /// let (sender, receiver) = luna_channels::buffered(luna_channels::Buffer::fifo(1));
    /// sender.try_send("hello")?;
    /// assert_eq!(block_on(receiver.recv()), Ok("hello"));
    /// # Ok::<(), luna_channels::TrySendError<&str>>(())
    /// ```
    #[inline]
    pub fn recv(&self) -> RecvOp<'_, T> {
        RecvOp::receiving(&self.0)
    }

    /// Receives by *extended rendezvous*: the sender is held until what this returns is dropped or
    /// finished.
    ///
    /// For work that is to be done between the communication and the sender's going on: passing the
    /// value on through a filter that the sender is not to notice, acknowledging only what was
    /// acted upon. On a channel with a buffer no sender is held, since the buffer took the value
    /// from its sender. A [`try_send`](crate::Sender::try_send) cannot be held, and so does not
    /// find this receiver. Works as a guard. Cancel-safety and the real-time path: as
    /// [`recv`](Self::recv).
    ///
    /// ```
    /// # use futures_lite::future::{block_on, zip};
    /// let (sender, receiver) = luna_channels::channel();
    /// let serve = async {
    ///     let request: luna_channels::Extended<'_, u32> = receiver.recv_extended().await?;
    ///     assert_eq!(*request, 5);
    ///     request.finish(); // only now does the sender go on
    ///     Ok::<(), luna_channels::RecvError>(())
    /// };
    /// assert_eq!(block_on(zip(serve, sender.send(5))), (Ok(()), Ok(())));
    /// ```
    #[inline]
    pub fn recv_extended(&self) -> RecvOp<'_, T, Extending> {
        RecvOp::receiving(&self.0)
    }

    /// Receives at once: only if a sender waits or something is buffered. The real-time path may
    /// call it; O(1).
    ///
    /// # Errors
    ///
    /// [`TryRecvError`].
    ///
    /// ```
    /// let (sender, receiver) = luna_channels::channel::<u32>();
    /// assert!(receiver.try_recv().unwrap_err().is_empty());
    /// drop(sender);
    /// assert!(receiver.try_recv().unwrap_err().is_closed());
    /// ```
    pub fn try_recv(&self) -> Result<T, TryRecvError> {
        self.recv().at_once().map_err(TryRecvError::from)
    }

    /// Like [`recv`](Self::recv), for at most `timeout` from its first poll on. Exact: it times out
    /// only if no value was taken. One that need not wait does not read the clock.
    ///
    /// # Panics
    ///
    /// When it has to wait on a thread that runs no process of LUNA: there it has no timers. Drop a
    /// plain `recv` at your runtime's timeout instead, which loses nothing either.
    ///
    /// ```
    /// # luna_core::block_on(async {
    /// let (_sender, receiver) = luna_channels::channel::<u32>();
    /// let late = receiver.recv_timeout(std::time::Duration::from_millis(1)).await;
    /// assert!(late.unwrap_err().is_timeout());
    /// # }).unwrap();
    /// ```
    #[inline]
    pub fn recv_timeout(&self, timeout: Duration) -> RecvTimeout<'_, T> {
        self.recv().until(Sleep::after(timeout))
    }

    /// Like [`recv_timeout`](Self::recv_timeout), until an absolute deadline: so several operations
    /// can share one.
    ///
    /// ```
    /// use luna_platform::clock::Instant;
    /// # luna_core::block_on(async {
    /// let (_sender, receiver) = luna_channels::channel::<u32>();
    /// assert!(receiver.recv_deadline(Instant::now()).await.unwrap_err().is_timeout());
    /// # }).unwrap();
    /// ```
    #[inline]
    pub fn recv_deadline(&self, deadline: Instant) -> RecvTimeout<'_, T> {
        self.recv().until(Sleep::until(deadline))
    }

    /// Like [`recv`](Self::recv), until `stop` has ended: then it gives up, as at a deadline.
    /// Exact: it gives up only if no value was taken. The value comes first if both are there. A
    /// recorded process gives up in a replay where it did, and `stop` is not asked.
    ///
    /// For what is to end a wait now and then, and is waited for all the time: `stop` may be a
    /// `Pin<&mut F>` of something that lives longer, so a receive costs one poll of it, and only
    /// when it waits. Cancel-safe as `recv`. Real-time path: yes, as far as `stop` is.
    ///
    /// # Errors
    ///
    /// [`RecvTimeoutError::Timeout`] if it was given up, else as for `recv`.
    ///
    /// ```
    /// # luna_core::block_on(async {
    /// let (sender, receiver) = luna_channels::channel::<u32>();
    /// let (keeps, over) = luna_channels::channel::<()>();
    /// drop(keeps);
    /// let stop = async { assert!(over.recv().await.is_err()) };
    /// assert!(receiver.recv_unless(stop).await.unwrap_err().is_timeout());
    /// # drop(sender);
    /// # }).unwrap();
    /// ```
    pub fn recv_unless<S: Future<Output = ()>>(&self, stop: S) -> RecvTimeout<'_, T, S> {
        self.recv().until(stop)
    }

    /// Like [`recv`](Self::recv), blocking this thread. For plain threads and OS-thread processes.
    ///
    /// # Errors
    ///
    /// As for `recv`.
    ///
    /// # Panics
    ///
    /// In a process of an executor, which it would stop.
    #[cfg(not(loom))]
    #[track_caller]
    pub fn blocking_recv(&self) -> Result<T, RecvError> {
        luna_core::park::block_on(self.recv())
    }

    /// Like [`blocking_recv`](Self::blocking_recv), for at most `timeout`.
    ///
    /// # Errors
    ///
    /// [`RecvTimeoutError`].
    ///
    /// # Panics
    ///
    /// As for `blocking_recv`.
    ///
    /// ```
    /// use std::time::Duration;
    /// let (_sender, receiver) = luna_channels::channel::<u32>();
    /// let error = receiver.blocking_recv_timeout(Duration::from_millis(1)).unwrap_err();
    /// assert!(error.is_timeout());
    /// ```
    #[cfg(not(loom))]
    #[track_caller]
    pub fn blocking_recv_timeout(&self, timeout: Duration) -> Result<T, RecvTimeoutError> {
        crate::replay::block_for(self.recv(), timeout)
    }

    /// The values as a stream, which ends when the channel is closed or poisoned.
    ///
    /// ```
    /// # use futures_lite::{StreamExt, future::block_on};
    /// let (sender, receiver) = luna_channels::buffered(luna_channels::Buffer::fifo(3));
    /// for n in 1..=3 {
    ///     sender.try_send(n)?;
    /// }
    /// drop(sender);
    /// assert_eq!(block_on(receiver.stream().collect::<Vec<_>>()), [1, 2, 3]);
    /// # Ok::<(), luna_channels::TrySendError<i32>>(())
    /// ```
    pub fn stream(&self) -> Incoming<'_, T> {
        Incoming::new(self)
    }

    /// As [`stream`](Self::stream), with the receiver in it. Allocates once, here; what it does
    /// afterwards is for the real-time path.
    ///
    /// ```
    /// # use futures_lite::{StreamExt, future::block_on};
    /// let (sender, receiver) = luna_channels::buffered(luna_channels::Buffer::fifo(2));
    /// sender.try_send(1)?;
    /// sender.try_send(2)?;
    /// drop(sender);
    /// let mut doubled = receiver.into_stream().map(|n| 2 * n);
    /// assert_eq!(block_on(doubled.next()), Some(2));
    /// assert_eq!(block_on(doubled.next()), Some(4));
    /// assert_eq!(block_on(doubled.next()), None);
    /// assert_eq!(block_on(doubled.next()), None); // as often as it is polled
    /// # Ok::<(), luna_channels::TrySendError<i32>>(())
    /// ```
    pub fn into_stream(self) -> impl Stream<Item = T> + Unpin + use<T> {
        let values = stream::unfold(self, |receiver| async move {
            let value = receiver.recv().await.ok()?;
            Some((value, receiver))
        });
        Box::pin(values.fuse())
    }

    /// Poisons the channel: see [`Sender::poison`](crate::Sender::poison).
    pub fn poison(&self) {
        self.0.poison();
    }

    /// Waits until the channel is poisoned, and takes nothing from it: for a process that does
    /// other things before it receives. If the senders go, it waits on. All else is as for
    /// [`Sender::ended`](crate::Sender::ended).
    ///
    /// ```
    /// # use futures_lite::future::{block_on, zip};
    /// use luna_channels::ChannelEnd;
    /// let (sender, receiver) = luna_channels::channel::<u32>();
    /// let end = block_on(zip(receiver.poisoned(), async { sender.poison() })).0;
    /// assert_eq!(end, ChannelEnd::Poisoned);
    /// ```
    pub fn poisoned(&self) -> Ended<'_> {
        Ended::new(self.channel().wait_point(), true)
    }

    /// Waits until the senders are gone or the channel is poisoned, and takes nothing from it:
    /// values may be left in its buffer. For a process that does other things before it receives.
    /// All else is as for [`Sender::ended`](crate::Sender::ended).
    ///
    /// ```
    /// # use futures_lite::future::block_on;
    /// use luna_channels::ChannelEnd;
    /// let (sender, receiver) = luna_channels::channel::<u32>();
    /// drop(sender);
    /// assert_eq!(block_on(receiver.ended()), ChannelEnd::Closed);
    /// ```
    pub fn ended(&self) -> Ended<'_> {
        Ended::new(self.channel().wait_point(), false)
    }

    /// Names the channel in reports: see [`inspect`](crate::inspect). Not for the real-time path.
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        self.0.set_name(name);
        self
    }

    /// Declares that a user of the channel is outside of the system: see
    /// [`Sender::external`](crate::Sender::external).
    #[must_use]
    pub fn external(self) -> Self {
        self.0.set_external();
        self
    }

    /// Number of buffered values: for display, since it may have changed already. Values of waiting
    /// senders do not count.
    pub fn buffered(&self) -> usize {
        self.channel().buffered()
    }
}

impl<T> Clone for Receiver<T> {
    fn clone(&self) -> Self {
        self.channel().add_receiver();
        // SAFETY: the receiver that was just counted.
        unsafe { Receiver::new(self.0.pointer()) }
    }
}

impl<T> Drop for Receiver<T> {
    fn drop(&mut self) {
        // SAFETY: this receiver is not used again.
        unsafe { Channel::drop_end(self.0.pointer(), false) };
    }
}

impl<T> fmt::Debug for Receiver<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Receiver")
            .field("channel", &self.0)
            .finish()
    }
}
