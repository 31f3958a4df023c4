//! Sending.

use crate::core::{Channel, Ending, Sent};
use crate::error::{SendError, SendTimeoutError, TrySendError};
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

/// The sending end of a channel. Any number of clones, on any threads, may send at the same time.
///
/// Dropping the last one closes the channel: what was sent is still received, then receivers get
/// [`RecvError::Closed`](crate::RecvError::Closed). Cloning is not for the real-time path; dropping is O(1), and O(waiting
/// receivers) for the last one.
pub struct Sender<T> {
    channel: NonNull<Channel<T>>,
    _values: PhantomData<T>,
}

// SAFETY: the channel is shared under its lock and by atomics; values pass from thread to thread.
unsafe impl<T: Send> Send for Sender<T> {}
// SAFETY: as above.
unsafe impl<T: Send> Sync for Sender<T> {}
impl<T> std::panic::UnwindSafe for Sender<T> {}
impl<T> std::panic::RefUnwindSafe for Sender<T> {}
// The values lie in the channel, not in its ends.
impl<T> Unpin for Sender<T> {}

impl<T> Sender<T> {
    /// # Safety
    ///
    /// The caller gives this one of the senders that the channel counts.
    pub(crate) unsafe fn new(channel: NonNull<Channel<T>>) -> Self {
        Self {
            channel,
            _values: PhantomData,
        }
    }

    #[inline]
    pub(crate) fn channel(&self) -> &Channel<T> {
        // SAFETY: this sender keeps the channel alive.
        unsafe { self.channel.as_ref() }
    }

    /// Offers `value` and waits until a receiver has taken it, or the buffer.
    ///
    /// Fails when the last receiver is gone or the channel is poisoned, and gives the value back. Cancel-safe: dropping the future
    /// withdraws and drops a value that nobody has taken; one that was taken stays sent. Real-time path: yes; no allocation,
    /// O(1), and O(waiting senders of lower priority) to wait.
    ///
    /// ```
    /// # use futures_lite::future::{block_on, zip};
    /// let (sender, receiver) = luna_channels::channel();
    /// let (sent, received) = block_on(zip(sender.send(5), receiver.recv()));
    /// assert_eq!((sent, received), (Ok(()), Ok(5)));
    /// ```
    #[inline]
    pub fn send(&self, value: T) -> SendOp<'_, T> {
        SendOp {
            sender: self,
            waiter: UnsafeCell::new(Waiter::with_value(value)),
            phase: Phase::New,
            _pinned: PhantomPinned,
        }
    }

    /// Sends at once: only if a receiver waits or the buffer has room. The real-time path may call it; O(1).
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
        let channel = self.channel();
        let sent = channel.send_now(&mut channel.lock(), value);
        match sent {
            Sent::Done(ready, dropped) => {
                ready.wake();
                drop(dropped);
                Ok(())
            }
            Sent::Full(value) => Err(TrySendError::Full(value)),
            Sent::Ended(value, Ending::Poisoned) => Err(TrySendError::Poisoned(value)),
            Sent::Ended(value, _) => Err(TrySendError::Closed(value)),
        }
    }

    /// Like [`send`](Self::send), for at most `timeout`. Exact: it times out only if nobody took the value.
    ///
    /// # Panics
    ///
    /// When it has to wait on a thread that runs no process of LUNA: there it has no timers. Drop a plain `send` at your runtime's
    /// timeout instead, which withdraws the value too.
    pub fn send_timeout(&self, value: T, timeout: Duration) -> SendTimeout<'_, T> {
        self.send_deadline(value, Instant::now() + timeout)
    }

    /// Like [`send_timeout`](Self::send_timeout), until an absolute deadline.
    pub fn send_deadline(&self, value: T, deadline: Instant) -> SendTimeout<'_, T> {
        SendTimeout {
            send: self.send(value),
            sleep: Sleep::until(deadline),
        }
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
        luna_platform::park::block_on(self.send(value))
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
        let mut send = std::pin::pin!(self.send(value));
        match luna_platform::park::block_on_until(send.as_mut(), Instant::now() + timeout) {
            Some(sent) => sent.map_err(SendTimeoutError::from),
            None => send.give_up(),
        }
    }

    /// Poisons the channel: all operations that wait on it, and all that come to it later, on both ends, fail as poisoned.
    ///
    /// What was communicated before stays communicated; what is still buffered is dropped. May be called more than once.
    /// Real-time path: yes; O(those who wait + what is buffered).
    ///
    /// ```
    /// let (sender, receiver) = luna_channels::channel::<u32>();
    /// sender.poison();
    /// assert!(receiver.blocking_recv().unwrap_err().is_poisoned());
    /// ```
    pub fn poison(&self) {
        self.channel().poison();
    }
}

impl<T> Clone for Sender<T> {
    fn clone(&self) -> Self {
        self.channel().add_sender();
        // SAFETY: the sender that was just counted.
        unsafe { Sender::new(self.channel) }
    }
}

impl<T> Drop for Sender<T> {
    fn drop(&mut self) {
        // SAFETY: this sender is not used again.
        unsafe { Channel::drop_sender(self.channel) };
    }
}

impl<T> fmt::Debug for Sender<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Sender")
            .field("channel", &self.channel)
            .finish()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Not polled yet; the node holds the value.
    New,
    /// The node is in the list, or has been settled.
    Listed,
    /// Sent; the process lets others run before it goes on.
    GaveWay,
    /// The outcome was returned.
    Over,
}

/// A send under way: see [`Sender::send`].
///
/// # Invariants
///
/// The waiter holds the value in `New`, and in `Listed` unless its outcome is `Done`. In `Listed` it is pinned.
#[must_use = "an operation does nothing unless awaited: add `.await`"]
pub struct SendOp<'a, T> {
    sender: &'a Sender<T>,
    waiter: UnsafeCell<Waiter<T>>,
    phase: Phase,
    _pinned: PhantomPinned,
}

// SAFETY: a listed waiter is guarded by the channel's lock wherever the future is; the value passes between threads anyway.
unsafe impl<T: Send> Send for SendOp<'_, T> {}
// SAFETY: `&SendOp` gives access to nothing.
unsafe impl<T: Send> Sync for SendOp<'_, T> {}

impl<T> SendOp<'_, T> {
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

    fn failed(&mut self, ending: Outcome) -> SendError<T> {
        self.phase = Phase::Over;
        SendError {
            // SAFETY: the send failed, so the value is still here, and nobody else knows the node any more.
            value: unsafe { self.waiter().take_value() },
            poisoned: ending == Outcome::Poisoned,
        }
    }

    /// What a settled send returns.
    fn settled(&mut self, outcome: Outcome) -> Result<(), SendError<T>> {
        if outcome == Outcome::Done {
            self.phase = Phase::Over;
            Ok(())
        } else {
            Err(self.failed(outcome))
        }
    }

    /// Withdraws what nobody has taken: exact, since the outcome is looked at first.
    fn give_up(self: Pin<&mut Self>) -> Result<(), SendTimeoutError<T>> {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        match this.phase {
            Phase::New => Err(SendTimeoutError::Timeout(
                this.failed(Outcome::Closed).value,
            )),
            Phase::GaveWay | Phase::Over => Ok(()),
            Phase::Listed => {
                // SAFETY: the node was listed on the senders' side.
                match unsafe { this.sender.channel().withdraw(this.node(), true) } {
                    Outcome::Waiting => Err(SendTimeoutError::Timeout(
                        this.failed(Outcome::Closed).value,
                    )),
                    outcome => this.settled(outcome).map_err(SendTimeoutError::from),
                }
            }
        }
    }

    fn poll_listed(&mut self, cx: &Context<'_>) -> Poll<Result<(), SendError<T>>> {
        // SAFETY: the node lies in this future.
        let mut outcome = unsafe { Waiter::outcome(self.node()) };
        if outcome == Outcome::Waiting {
            if current::branch_failed() {
                // SAFETY: the node was listed on the senders' side.
                outcome = unsafe { self.sender.channel().withdraw(self.node(), true) };
                if outcome == Outcome::Waiting {
                    return Poll::Ready(Err(self.failed(Outcome::Poisoned)));
                }
            } else {
                // SAFETY: the node was listed.
                outcome = unsafe { self.sender.channel().update_wakeup(self.node(), cx) };
                if outcome == Outcome::Waiting {
                    return Poll::Pending;
                }
            }
        }
        Poll::Ready(self.settled(outcome))
    }
}

impl<T> Future for SendOp<'_, T> {
    type Output = Result<(), SendError<T>>;

    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: nothing pinned is moved: a listed node stays in its place.
        let this = unsafe { self.get_unchecked_mut() };
        match this.phase {
            Phase::New => {}
            Phase::Listed => return this.poll_listed(cx),
            Phase::GaveWay => {
                this.phase = Phase::Over;
                return Poll::Ready(Ok(()));
            }
            Phase::Over => panic!("a send was polled after it was over"),
        }
        if current::branch_failed() {
            return Poll::Ready(Err(this.failed(Outcome::Poisoned)));
        }
        let channel = this.sender.channel();
        let mut state = channel.lock();
        // SAFETY: a new send's node holds its value, and nobody else knows it.
        let value = unsafe { this.waiter().take_value() };
        match channel.send_now(&mut state, value) {
            Sent::Done(ready, dropped) => {
                // Before the user's code below (a waker, a drop) can panic: the value is gone.
                this.phase = Phase::Over;
                drop(state);
                ready.wake();
                drop(dropped);
                if crate::gives_way(cx) {
                    this.phase = Phase::GaveWay;
                    return Poll::Pending;
                }
                Poll::Ready(Ok(()))
            }
            Sent::Full(value) => {
                // SAFETY: the value goes back to where it came from; the future is pinned, and its drop withdraws the node.
                unsafe {
                    this.waiter().put_value(value);
                    Channel::list_sender(
                        &mut state,
                        this.node(),
                        current::priority(),
                        Wakeup::of(cx),
                    );
                }
                this.phase = Phase::Listed;
                Poll::Pending
            }
            Sent::Ended(value, ending) => {
                drop(state);
                this.phase = Phase::Over;
                Poll::Ready(Err(SendError {
                    value,
                    poisoned: ending == Ending::Poisoned,
                }))
            }
        }
    }
}

impl<T> Drop for SendOp<'_, T> {
    #[inline]
    fn drop(&mut self) {
        let holds_value = match self.phase {
            Phase::New => true,
            // SAFETY: the node was listed on the senders' side.
            Phase::Listed => unsafe {
                self.sender.channel().withdraw(self.node(), true) != Outcome::Done
            },
            Phase::GaveWay | Phase::Over => false,
        };
        if holds_value {
            // SAFETY: the value is still here, and nobody else knows the node any more.
            drop(unsafe { self.waiter().take_value() });
        }
    }
}

impl<T> fmt::Debug for SendOp<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SendOp")
            .field("phase", &self.phase)
            .finish_non_exhaustive()
    }
}

/// A send under way that gives up at a deadline: see [`Sender::send_timeout`].
#[derive(Debug)]
#[must_use = "an operation does nothing unless awaited"]
pub struct SendTimeout<'a, T> {
    send: SendOp<'a, T>,
    sleep: Sleep,
}

impl<T> Future for SendTimeout<'_, T> {
    type Output = Result<(), SendTimeoutError<T>>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: both fields are pinned with the whole, and never moved.
        let (mut send, sleep) = unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.send),
                Pin::new_unchecked(&mut this.sleep),
            )
        };
        if let Poll::Ready(sent) = send.as_mut().poll(cx) {
            return Poll::Ready(sent.map_err(SendTimeoutError::from));
        }
        // One that has communicated lets others run, and is done then, whatever the time is.
        if send.phase == Phase::GaveWay {
            return Poll::Pending;
        }
        match sleep.poll(cx) {
            Poll::Ready(()) => Poll::Ready(send.give_up()),
            Poll::Pending => Poll::Pending,
        }
    }
}
