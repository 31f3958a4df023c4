//! Receiving.

use crate::core::{Channel, Ending, Received};
use crate::error::{RecvError, RecvTimeoutError, TryRecvError};
use crate::stream::Incoming;
use crate::waiter::{Outcome, Waiter};
use luna_platform::clock::Instant;
use luna_platform::current::{self, Wakeup};
use luna_platform::timer_queue::Sleep;
use std::cell::UnsafeCell;
use std::fmt;
use std::future::Future;
use std::marker::{PhantomData, PhantomPinned};
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll};
use std::time::Duration;

/// The receiving end of a channel. Any number of clones, on any threads, may receive at the same time; each value goes to one.
///
/// Dropping the last one closes the channel: senders get their values back, and what is buffered is dropped. Cloning is not for the
/// real-time path; dropping is O(1), and O(waiting senders + buffered values) for the last one.
pub struct Receiver<T> {
    channel: NonNull<Channel<T>>,
    _values: PhantomData<T>,
}

// SAFETY: the channel is shared under its lock and by atomics; values pass from thread to thread.
unsafe impl<T: Send> Send for Receiver<T> {}
// SAFETY: as above.
unsafe impl<T: Send> Sync for Receiver<T> {}
impl<T> std::panic::UnwindSafe for Receiver<T> {}
impl<T> std::panic::RefUnwindSafe for Receiver<T> {}
// The values lie in the channel, not in its ends.
impl<T> Unpin for Receiver<T> {}

impl<T> Receiver<T> {
    /// # Safety
    ///
    /// The caller gives this one of the receivers that the channel counts.
    pub(crate) unsafe fn new(channel: NonNull<Channel<T>>) -> Self {
        Self {
            channel,
            _values: PhantomData,
        }
    }

    #[inline]
    pub(crate) fn channel(&self) -> &Channel<T> {
        // SAFETY: this receiver keeps the channel alive.
        unsafe { self.channel.as_ref() }
    }

    /// Waits for a value.
    ///
    /// Of several that wait the one of highest priority gets it, of equal ones the one that came first. Fails when the last
    /// sender is gone and nothing is left, or when the channel is poisoned. Cancel-safe: a future that is dropped while it waits leaves no
    /// trace; one that is dropped after it was given a value puts it back at the head of the channel. Real-time path: yes;
    /// no allocation, O(1), and O(waiting receivers of lower priority) to wait.
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
        RecvOp {
            receiver: self,
            waiter: UnsafeCell::new(Waiter::empty()),
            phase: Phase::New,
            _pinned: PhantomPinned,
        }
    }

    /// Receives at once: only if a sender waits or something is buffered. The real-time path may call it; O(1).
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
        let channel = self.channel();
        let received = channel.recv_now(&mut channel.lock());
        match received {
            Received::Done(value, ready) => {
                ready.wake();
                Ok(value)
            }
            Received::Empty => Err(TryRecvError::Empty),
            Received::Ended(Ending::Poisoned) => Err(TryRecvError::Poisoned),
            Received::Ended(_) => Err(TryRecvError::Closed),
        }
    }

    /// Like [`recv`](Self::recv), for at most `timeout`. Exact: it times out only if no value was taken.
    ///
    /// # Panics
    ///
    /// When it has to wait on a thread that runs no process of LUNA: there it has no timers. Drop a plain `recv` at your runtime's
    /// timeout instead, which loses nothing either.
    pub fn recv_timeout(&self, timeout: Duration) -> RecvTimeout<'_, T> {
        self.recv_deadline(Instant::now() + timeout)
    }

    /// Like [`recv_timeout`](Self::recv_timeout), until an absolute deadline.
    pub fn recv_deadline(&self, deadline: Instant) -> RecvTimeout<'_, T> {
        RecvTimeout {
            recv: self.recv(),
            sleep: Sleep::until(deadline),
        }
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
        luna_platform::park::block_on(self.recv())
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
        let mut recv = std::pin::pin!(self.recv());
        match luna_platform::park::block_on_until(recv.as_mut(), Instant::now() + timeout) {
            Some(received) => received.map_err(RecvTimeoutError::from),
            None => recv.give_up(),
        }
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

    /// Poisons the channel: see [`Sender::poison`](crate::Sender::poison).
    pub fn poison(&self) {
        self.channel().poison();
    }

    /// How many values are buffered: for display, since it may have changed already. Those of waiting senders do not count.
    pub fn buffered(&self) -> usize {
        self.channel().buffered()
    }
}

impl<T> Clone for Receiver<T> {
    fn clone(&self) -> Self {
        self.channel().add_receiver();
        // SAFETY: the receiver that was just counted.
        unsafe { Receiver::new(self.channel) }
    }
}

impl<T> Drop for Receiver<T> {
    fn drop(&mut self) {
        // SAFETY: this receiver is not used again.
        unsafe { Channel::drop_receiver(self.channel) };
    }
}

impl<T> fmt::Debug for Receiver<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Receiver")
            .field("channel", &self.channel)
            .finish()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Not polled yet.
    New,
    /// The node is in the list, or has been settled.
    Listed,
    /// Received; the node holds the value while the process lets others run.
    GaveWay,
    /// The outcome was returned.
    Over,
}

/// A receive under way: see [`Receiver::recv`].
///
/// # Invariants
///
/// The waiter holds a value in `GaveWay`, and in `Listed` once its outcome is `Done`. In `Listed` it is pinned.
#[must_use = "an operation does nothing unless awaited: add `.await`"]
pub struct RecvOp<'a, T> {
    receiver: &'a Receiver<T>,
    waiter: UnsafeCell<Waiter<T>>,
    phase: Phase,
    _pinned: PhantomPinned,
}

// SAFETY: a listed waiter is guarded by the channel's lock wherever the future is; the value passes between threads anyway.
unsafe impl<T: Send> Send for RecvOp<'_, T> {}
// SAFETY: `&RecvOp` gives access to nothing.
unsafe impl<T: Send> Sync for RecvOp<'_, T> {}

impl<T> RecvOp<'_, T> {
    #[inline]
    fn node(&self) -> NonNull<Waiter<T>> {
        // SAFETY: a cell's address is never null.
        unsafe { NonNull::new_unchecked(self.waiter.get()) }
    }

    /// Not to be called while the node is listed: others change it then.
    #[inline]
    fn waiter(&self) -> &Waiter<T> {
        // SAFETY: a node that is not listed, or was settled, is known to its future alone.
        unsafe { &*self.waiter.get() }
    }

    /// What a settled receive returns.
    #[inline]
    fn settled(&mut self, outcome: Outcome) -> Result<T, RecvError> {
        self.phase = Phase::Over;
        match outcome {
            // SAFETY: a done receive holds its value, and nobody else knows the node any more.
            Outcome::Done => Ok(unsafe { self.waiter().take_value() }),
            Outcome::Poisoned => Err(RecvError::Poisoned),
            _ => Err(RecvError::Closed),
        }
    }

    /// Withdraws: exact, since the outcome is looked at first.
    fn give_up(self: Pin<&mut Self>) -> Result<T, RecvTimeoutError> {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        match this.phase {
            Phase::New | Phase::Over => Err(RecvTimeoutError::Timeout),
            Phase::GaveWay => this.settled(Outcome::Done).map_err(RecvTimeoutError::from),
            Phase::Listed => {
                // SAFETY: the node was listed on the receivers' side.
                match unsafe { this.receiver.channel().withdraw(this.node(), false) } {
                    Outcome::Waiting => {
                        this.phase = Phase::Over;
                        Err(RecvTimeoutError::Timeout)
                    }
                    outcome => this.settled(outcome).map_err(RecvTimeoutError::from),
                }
            }
        }
    }

    fn poll_listed(&mut self, cx: &Context<'_>) -> Poll<Result<T, RecvError>> {
        // SAFETY: the node lies in this future.
        let mut outcome = unsafe { Waiter::outcome(self.node()) };
        if outcome == Outcome::Waiting {
            if current::branch_failed() {
                // SAFETY: the node was listed on the receivers' side.
                outcome = unsafe { self.receiver.channel().withdraw(self.node(), false) };
                if outcome == Outcome::Waiting {
                    outcome = Outcome::Poisoned;
                }
            } else {
                // SAFETY: the node was listed.
                outcome = unsafe { self.receiver.channel().update_wakeup(self.node(), cx) };
                if outcome == Outcome::Waiting {
                    return Poll::Pending;
                }
            }
        }
        Poll::Ready(self.settled(outcome))
    }
}

impl<T> Future for RecvOp<'_, T> {
    type Output = Result<T, RecvError>;

    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: nothing pinned is moved: a listed node stays in its place.
        let this = unsafe { self.get_unchecked_mut() };
        match this.phase {
            Phase::New => {}
            Phase::Listed => return this.poll_listed(cx),
            Phase::GaveWay => return Poll::Ready(this.settled(Outcome::Done)),
            Phase::Over => panic!("a receive was polled after it was over"),
        }
        if current::branch_failed() {
            this.phase = Phase::Over;
            return Poll::Ready(Err(RecvError::Poisoned));
        }
        let channel = this.receiver.channel();
        let mut state = channel.lock();
        match channel.recv_now(&mut state) {
            Received::Done(value, ready) => {
                drop(state);
                ready.wake();
                if crate::gives_way(cx) {
                    // SAFETY: a receive that was not listed holds no value, and nobody else knows its node.
                    unsafe { this.waiter().put_value(value) };
                    this.phase = Phase::GaveWay;
                    return Poll::Pending;
                }
                this.phase = Phase::Over;
                Poll::Ready(Ok(value))
            }
            Received::Empty => {
                // SAFETY: the future is pinned, and its drop withdraws the node.
                unsafe {
                    Channel::list_receiver(
                        &mut state,
                        this.node(),
                        current::priority(),
                        Wakeup::of(cx),
                    )
                };
                this.phase = Phase::Listed;
                Poll::Pending
            }
            Received::Ended(ending) => {
                drop(state);
                this.phase = Phase::Over;
                Poll::Ready(Err(match ending {
                    Ending::Poisoned => RecvError::Poisoned,
                    _ => RecvError::Closed,
                }))
            }
        }
    }
}

impl<T> Drop for RecvOp<'_, T> {
    #[inline]
    fn drop(&mut self) {
        let holds_value = match self.phase {
            Phase::New | Phase::Over => false,
            Phase::GaveWay => true,
            // SAFETY: the node was listed on the receivers' side.
            Phase::Listed => unsafe {
                self.receiver.channel().withdraw(self.node(), false) == Outcome::Done
            },
        };
        if holds_value {
            // SAFETY: the value is here, and nobody else knows the node any more.
            let value = unsafe { self.waiter().take_value() };
            self.receiver.channel().give_back(value);
        }
    }
}

impl<T> fmt::Debug for RecvOp<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RecvOp")
            .field("phase", &self.phase)
            .finish_non_exhaustive()
    }
}

/// A receive under way that gives up at a deadline: see [`Receiver::recv_timeout`].
#[derive(Debug)]
#[must_use = "an operation does nothing unless awaited"]
pub struct RecvTimeout<'a, T> {
    recv: RecvOp<'a, T>,
    sleep: Sleep,
}

impl<T> Future for RecvTimeout<'_, T> {
    type Output = Result<T, RecvTimeoutError>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: both fields are pinned with the whole, and never moved.
        let (mut recv, sleep) = unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.recv),
                Pin::new_unchecked(&mut this.sleep),
            )
        };
        if let Poll::Ready(received) = recv.as_mut().poll(cx) {
            return Poll::Ready(received.map_err(RecvTimeoutError::from));
        }
        // One that has communicated lets others run, and is done then, whatever the time is.
        if recv.phase == Phase::GaveWay {
            return Poll::Pending;
        }
        match sleep.poll(cx) {
            Poll::Ready(()) => Poll::Ready(recv.give_up()),
            Poll::Pending => Poll::Pending,
        }
    }
}
