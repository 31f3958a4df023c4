//! The end of a channel for sending.

use crate::core::Channel;
use crate::end::End;
use crate::ended::Ended;
use crate::error::{SendError, SendTimeoutError, TrySendError};
use crate::operation::{SendOp, SendTimeout};
use crate::source::{FromSlot, Made};
use crate::waiter::Waiter;
use core::fmt;
use core::ptr::NonNull;
use core::time::Duration;
use luna_core::timer_queue::Sleep;
use luna_platform::clock::Instant;

/// The sending end of a channel. Any number of clones, on any threads, may send at the same time.
///
/// Dropping the last one closes the channel: what was sent is still received, then receivers get
/// [`RecvError::Closed`](crate::RecvError::Closed). Cloning is not for the real-time path; dropping
/// is O(1), and O(waiting receivers) for the last one.
pub struct Sender<T>(End<T>);

impl<T> Sender<T> {
    /// # Safety
    ///
    /// The caller gives this one of the senders that the channel counts.
    pub(crate) unsafe fn new(channel: NonNull<Channel<T>>) -> Self {
        // SAFETY: the caller gives this a sender that the channel counts, as is demanded here: so
        // the end keeps the channel.
        Self(unsafe { End::new(channel) })
    }

    #[inline]
    pub(crate) fn end(&self) -> &End<T> {
        &self.0
    }

    fn channel(&self) -> &Channel<T> {
        self.0.channel()
    }

    /// Offers `value` and waits until a receiver has taken it, or the buffer.
    ///
    /// Fails when the last receiver is gone or the channel is poisoned, and gives the value back.
    /// Cancel-safe: dropping the future withdraws and drops a value that was not taken; one that
    /// was taken stays sent. A send that need not wait is a scheduling point all the same, whether
    /// it succeeds or fails: see [`Receiver::recv`](crate::Receiver::recv). Real-time path: yes; no
    /// allocation, O(1), and O(waiting senders of lower priority) to wait.
    ///
    /// ```
    /// # use futures_lite::future::{block_on, zip};
    /// let (sender, receiver) = luna_channels::channel();
    /// let (sent, received) = block_on(zip(sender.send(5), receiver.recv()));
    /// assert_eq!((sent, received), (Ok(()), Ok(5)));
    /// ```
    #[inline]
    pub fn send(&self, value: T) -> SendOp<'_, T> {
        SendOp::of_value(&self.0, value)
    }

    /// Like [`send`](Self::send), with a value that stays in `slot` until it is taken: in an
    /// alternative that chooses another guard it is still there afterwards. An empty slot offers
    /// nothing: as a guard it is never ready, awaited alone it waits for ever.
    ///
    /// ```
    /// use luna_channels::{alt, at, channel};
    /// # luna_core::block_on(async {
    /// let (sender, _receiver) = channel();
    /// let mut slot = Some(String::from("precious"));
    /// alt! {
    ///     sent = sender.send_from(&mut slot) => sent.unwrap(),
    ///     skip => {} // nobody receives
    /// }
    /// assert_eq!(slot.as_deref(), Some("precious"));
    /// # }).unwrap();
    /// ```
    #[inline]
    pub fn send_from<'a>(&'a self, slot: &'a mut Option<T>) -> SendOp<'a, T, FromSlot<'a, T>> {
        let (waiter, source) = FromSlot::take_from(slot);
        SendOp::sending(&self.0, waiter, source)
    }

    /// Like [`send`](Self::send), with a value that `make` makes when it is taken, and not
    /// otherwise.
    ///
    /// `make` runs on the side that completes the communication, under the locks of all channels
    /// that side chooses among. So it is short, and uses and drops no end of a channel, no lock,
    /// and nothing that allocates where that matters. It borrows nothing (`move` all that it needs
    /// into it), since it may be run by another thread after this future was leaked. If it panics,
    /// the channel is poisoned, and the process that offered panics.
    ///
    /// ```
    /// use luna_channels::{alt, channel};
    /// # luna_core::block_on(async {
    /// let (sender, receiver) = channel::<u64>();
    /// alt! {
    ///     sent = sender.send_with(|| panic!("nobody receives")) => sent.unwrap(),
    ///     skip => {}
    /// }
    /// let thread = std::thread::spawn(move || receiver.blocking_recv());
    /// sender.send_with(|| 2 + 2).await.unwrap();
    /// assert_eq!(thread.join().unwrap(), Ok(4));
    /// # }).unwrap();
    /// ```
    #[inline]
    pub fn send_with<F: FnOnce() -> T + Send + 'static>(&self, make: F) -> SendOp<'_, T, Made<F>> {
        SendOp::sending(&self.0, Waiter::empty(), Made::new(make))
    }

    /// Sends at once: only if a receiver waits or the buffer has room. The real-time path may call
    /// it; O(1).
    ///
    /// # Errors
    ///
    /// [`TrySendError`], with the value.
    ///
    /// ```
    /// let (sender, receiver) = luna_channels::channel();
    /// assert!(sender.try_send(1).unwrap_err().is_full()); // a rendezvous: nobody waits
    /// drop(receiver);
    /// assert!(sender.try_send(1).unwrap_err().is_closed());
    /// ```
    pub fn try_send(&self, value: T) -> Result<(), TrySendError<T>> {
        self.send(value).at_once().map_err(TrySendError::from)
    }

    /// Like [`send`](Self::send), for at most `timeout` from its first poll on. Exact: it times out
    /// only if the value was not taken. One that need not wait does not read the clock.
    ///
    /// # Panics
    ///
    /// When it has to wait on a thread that runs no process of LUNA: there it has no timers. Drop a
    /// plain `send` at your runtime's timeout instead, which withdraws the value too.
    ///
    /// ```
    /// # luna_core::block_on(async {
    /// let (sender, _receiver) = luna_channels::channel();
    /// let late = sender.send_timeout(5, std::time::Duration::from_millis(1)).await.unwrap_err();
    /// assert!(late.is_timeout());
    /// assert_eq!(late.into_inner(), 5);
    /// # }).unwrap();
    /// ```
    #[inline]
    pub fn send_timeout(&self, value: T, timeout: Duration) -> SendTimeout<'_, T> {
        self.send(value).until(Sleep::after(timeout))
    }

    /// Like [`send_timeout`](Self::send_timeout), until an absolute deadline: so several operations
    /// can share one. A sender that is held by an extended rendezvous goes on at the deadline, and
    /// has sent.
    ///
    /// ```
    /// use luna_platform::clock::Instant;
    /// # luna_core::block_on(async {
    /// let (sender, _receiver) = luna_channels::channel();
    /// assert!(sender.send_deadline(5, Instant::now()).await.unwrap_err().is_timeout());
    /// # }).unwrap();
    /// ```
    #[inline]
    pub fn send_deadline(&self, value: T, deadline: Instant) -> SendTimeout<'_, T> {
        self.send(value).until(Sleep::until(deadline))
    }

    /// Like [`send`](Self::send), until `stop` has ended: then it gives up, as at a deadline, and
    /// gives the value back. Exact: it gives up only if the value was not taken. To send comes
    /// first if both are possible. A recorded process gives up in a replay where it did, and `stop`
    /// is not asked.
    ///
    /// For an offer that is to be withdrawn when something makes it wrong before it is taken:
    /// `stop` may be a `Pin<&mut F>` of something that lives longer, so a send costs one poll of
    /// it, and only when it waits. Cancel-safe as `send`. Real-time path: yes, as far as `stop` is.
    ///
    /// # Errors
    ///
    /// [`SendTimeoutError::Timeout`](crate::SendTimeoutError::Timeout) if it was given up, else as
    /// for `send`; each with the value.
    ///
    /// ```
    /// # luna_core::block_on(async {
    /// let (sender, _receiver) = luna_channels::channel();
    /// let (keeps, over) = luna_channels::channel::<()>();
    /// drop(keeps);
    /// let stop = async { assert!(over.recv().await.is_err()) };
    /// let error = sender.send_unless(5, stop).await.unwrap_err();
    /// assert!(error.is_timeout());
    /// assert_eq!(error.into_inner(), 5);
    /// # }).unwrap();
    /// ```
    pub fn send_unless<S: Future<Output = ()>>(&self, value: T, stop: S) -> SendTimeout<'_, T, S> {
        self.send(value).until(stop)
    }

    /// Like [`send`](Self::send), blocking this thread. For plain threads and OS-thread processes.
    ///
    /// # Errors
    ///
    /// As for `send`.
    ///
    /// # Panics
    ///
    /// In a process of an executor, which it would stop.
    #[cfg(not(loom))]
    #[track_caller]
    pub fn blocking_send(&self, value: T) -> Result<(), SendError<T>> {
        luna_core::park::block_on(self.send(value))
    }

    /// Like [`blocking_send`](Self::blocking_send), for at most `timeout`.
    ///
    /// # Errors
    ///
    /// [`SendTimeoutError`], with the value.
    ///
    /// # Panics
    ///
    /// As for `blocking_send`.
    ///
    /// ```
    /// use std::time::Duration;
    /// let (sender, _receiver) = luna_channels::channel();
    /// let error = sender.blocking_send_timeout(1, Duration::from_millis(1)).unwrap_err();
    /// assert!(error.is_timeout());
    /// ```
    #[cfg(not(loom))]
    #[track_caller]
    pub fn blocking_send_timeout(
        &self,
        value: T,
        timeout: Duration,
    ) -> Result<(), SendTimeoutError<T>> {
        crate::replay::block_for(self.send(value), timeout)
    }

    /// Poisons the channel: all operations that wait on it, and all that come to it later, on both
    /// ends, fail as poisoned.
    ///
    /// What was communicated before stays communicated; what is still buffered is dropped. May be
    /// called more than once. Real-time path: yes; O(waiting operations + buffered values).
    ///
    /// ```
    /// let (sender, receiver) = luna_channels::channel::<u32>();
    /// sender.poison();
    /// assert!(receiver.blocking_recv().unwrap_err().is_poisoned());
    /// ```
    pub fn poison(&self) {
        self.0.poison();
    }

    /// Waits until nothing more can be sent: the last receiver is gone, or the channel is poisoned.
    /// It offers nothing, and no receiver sees it; for a process that waits for other things before
    /// it sends.
    ///
    /// Cancel-safe. Real-time path: yes; no allocation, O(1), and O(waiters of lower priority for
    /// the same end) to wait.
    ///
    /// ```
    /// # use futures_lite::future::{block_on, zip};
    /// use luna_channels::ChannelEnd;
    /// let (sender, receiver) = luna_channels::channel::<u32>();
    /// let end = block_on(zip(sender.ended(), async { drop(receiver) })).0;
    /// assert_eq!(end, ChannelEnd::Closed);
    /// ```
    pub fn ended(&self) -> Ended<'_> {
        Ended::new(self.channel().wait_point(), false)
    }

    /// [`ended`](Self::ended), under the name that tokio's senders have for it.
    pub fn closed(&self) -> Ended<'_> {
        self.ended()
    }

    /// Names the channel in reports: see [`inspect`](crate::inspect). Not for the real-time path.
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        self.0.set_name(name);
        self
    }

    /// Declares that a user of the channel is outside of the system: a plain thread, a device. A
    /// process that waits on it is then never part of a deadlock. A channel that an outside thread
    /// has used already is known to have such a user.
    #[must_use]
    pub fn external(self) -> Self {
        self.0.set_external();
        self
    }
}

impl<T> Clone for Sender<T> {
    fn clone(&self) -> Self {
        self.channel().add_sender();
        // SAFETY: the sender that was just counted.
        unsafe { Sender::new(self.0.pointer()) }
    }
}

impl<T> Drop for Sender<T> {
    fn drop(&mut self) {
        // SAFETY: this sender is not used again.
        unsafe { Channel::drop_end(self.0.pointer(), true) };
    }
}

impl<T> fmt::Debug for Sender<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Sender").field("channel", &self.0).finish()
    }
}
