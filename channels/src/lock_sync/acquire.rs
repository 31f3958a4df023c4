//! Taking permits, as a future.

use super::entry::inheritor;
use super::error::{AcquireError, AcquireTimeoutError};
use super::permit::SemaphorePermit;
use super::semaphore::Semaphore;
use crate::replay::{self, GiveUp, Logged, Stage};
use crate::waiter::{Outcome, Waiter};
use luna_core::current::{self, Inheritor, Renewal};
use luna_core::replay_log::{Event, Turn};
use luna_core::timer_queue::Sleep;
use std::cell::UnsafeCell;
use std::fmt;
use std::future::Future;
use std::marker::PhantomPinned;
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    New,
    /// It has let others run, and takes the permits next.
    GaveWay,
    /// The node is in the semaphore's list, or was settled.
    Listed,
    /// It has its permits.
    Keeps,
    Over,
}

/// Taking permits of a semaphore: see [`Semaphore::acquire`].
///
/// # Invariants
///
/// In `Listed` it is pinned, and the node was begun.
#[must_use = "an operation does nothing unless awaited"]
pub struct AcquireOp<'a> {
    semaphore: &'a Semaphore,
    count: u32,
    node: UnsafeCell<Waiter<()>>,
    phase: Phase,
    /// The thread itself acquires, and waits at its priority.
    of_thread: bool,
    _pinned: PhantomPinned,
}

// SAFETY: a listed node is guarded by the semaphore's lock wherever the future is.
unsafe impl Send for AcquireOp<'_> {}
// SAFETY: `&AcquireOp` gives access to nothing.
unsafe impl Sync for AcquireOp<'_> {}

impl<'a> AcquireOp<'a> {
    pub(super) fn new(semaphore: &'a Semaphore, count: u32, of_thread: bool) -> Self {
        AcquireOp {
            semaphore,
            count,
            node: UnsafeCell::new(Waiter::empty()),
            phase: Phase::New,
            of_thread,
            _pinned: PhantomPinned,
        }
    }

    fn node(&self) -> NonNull<Waiter<()>> {
        // SAFETY: a cell's address is never null.
        unsafe { NonNull::new_unchecked(self.node.get()) }
    }

    /// The outcome of a listed acquire.
    fn outcome(&self) -> Outcome {
        // SAFETY: the node lies in this future, and was begun before it was listed.
        unsafe { Waiter::outcome(self.node()) }
    }

    fn poll_new(&mut self, cx: &Context<'_>) -> Poll<()> {
        let priority = inheritor(self.of_thread)
            .as_ref()
            .map_or_else(current::priority, Inheritor::priority_before_blocking);
        let shared = self.semaphore.shared();
        shared.note_user(current::user());
        let mut renewal = Renewal::of(cx);
        renewal.put(|renewal| {
            let mut lists = shared.wait_point.lock();
            if shared.take(&mut lists, self.count, priority) {
                self.phase = Phase::Keeps;
            } else if let Some(wake_handle) = renewal.take() {
                // SAFETY: the node is in no list, the future is pinned, and its drop takes it off.
                unsafe {
                    Waiter::begin(self.node(), false, None, None);
                    (*Waiter::link(self.node())).ticket = self.count;
                    lists
                        .senders
                        .insert(self.node().cast(), priority, wake_handle);
                }
                self.phase = Phase::Listed;
            }
        });
        if self.phase == Phase::Keeps {
            return Poll::Ready(());
        }
        shared.wait_point.waits();
        Poll::Pending
    }

    fn poll_listed(&mut self, cx: &Context<'_>) -> Poll<()> {
        if self.outcome() == Outcome::Done {
            return Poll::Ready(());
        }
        let mut renewal = Renewal::of(cx);
        let polled = renewal.put(|renewal| {
            let _lists = self.semaphore.shared().wait_point.lock();
            if self.outcome() == Outcome::Done {
                return Poll::Ready(());
            }
            // SAFETY: under the lock a waiting node may be changed.
            renewal.store(unsafe { (*Waiter::link(self.node())).wait.wake_handle_mut() });
            Poll::Pending
        });
        if polled.is_pending() {
            self.semaphore.shared().wait_point.waits();
        }
        polled
    }

    /// Takes it back, if it waits; `true` if it has its permits.
    fn withdraw(&mut self) -> bool {
        if self.phase != Phase::Listed {
            return self.phase == Phase::Keeps;
        }
        self.semaphore.shared().wait_point.waits_no_more();
        let mut lists = self.semaphore.shared().wait_point.lock();
        if self.outcome() == Outcome::Done {
            return true;
        }
        // SAFETY: a node that waits is in the list.
        let _former = unsafe {
            lists.senders.remove(self.node().cast());
            let former = (*Waiter::link(self.node())).wait.wake_handle_mut().take();
            Waiter::settle_stale(self.node());
            former
        };
        drop(lists);
        self.phase = Phase::Over;
        // Waiters behind it may want fewer permits.
        self.semaphore.shared().serve();
        false
    }

    fn acquired(&mut self) -> SemaphorePermit<'a> {
        self.phase = Phase::Over;
        // SAFETY: they were taken for this operation.
        unsafe { SemaphorePermit::new(self.semaphore, self.count) }
    }

    /// At a deadline.
    pub(super) fn give_up(
        self: Pin<&mut Self>,
    ) -> Result<SemaphorePermit<'a>, AcquireTimeoutError> {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        if this.withdraw() {
            return Ok(this.acquired());
        }
        this.phase = Phase::Over;
        Err(AcquireTimeoutError::Timeout)
    }
}

impl AcquireOp<'_> {
    /// Polls until it has its permits, or its branch has failed.
    fn poll_without_log(&mut self, cx: &Context<'_>) -> Poll<Result<(), AcquireError>> {
        if current::branch_failed() && self.phase != Phase::Over && !self.withdraw() {
            if self.phase == Phase::New && crate::fails_later(cx) {
                self.phase = Phase::GaveWay;
                return Poll::Pending;
            }
            self.phase = Phase::Over;
            current::stay_in_branch();
            return Poll::Ready(Err(AcquireError));
        }
        let polled = match self.phase {
            // Lets others run before it holds permits that they could wait for.
            Phase::New if crate::gives_way(cx) => {
                self.phase = Phase::GaveWay;
                return Poll::Pending;
            }
            Phase::New | Phase::GaveWay => self.poll_new(cx),
            Phase::Listed => self.poll_listed(cx),
            Phase::Keeps => Poll::Ready(()),
            Phase::Over => panic!("an acquire was polled after it was over"),
        };
        polled.map(Ok)
    }
}

impl<'a> Future for AcquireOp<'a> {
    type Output = Result<SemaphorePermit<'a>, AcquireError>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: nothing pinned is moved: a listed node stays in its place.
        let this = unsafe { self.get_unchecked_mut() };
        let polled = match replay::is_on() {
            true => replay::poll(this, cx),
            false => this.poll_without_log(cx),
        };
        polled.map(|polled| polled.map(|()| this.acquired()))
    }
}

impl Drop for AcquireOp<'_> {
    fn drop(&mut self) {
        if self.phase == Phase::Over {
            return;
        }
        replay::abandon(self.phase == Phase::New);
        if self.withdraw() {
            drop(self.acquired());
        }
    }
}

impl fmt::Debug for AcquireOp<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("AcquireOp")
            .field("count", &self.count)
            .field("phase", &self.phase)
            .finish_non_exhaustive()
    }
}

/// Taking permits until a deadline: see [`Semaphore::acquire_timeout`].
#[derive(Debug)]
#[must_use = "an operation does nothing unless awaited"]
pub struct AcquireTimeout<'a> {
    acquire: AcquireOp<'a>,
    sleep: Sleep,
}

impl<'a> AcquireTimeout<'a> {
    pub(super) fn new(semaphore: &'a Semaphore, sleep: Sleep) -> Self {
        AcquireTimeout {
            acquire: semaphore.acquire(),
            sleep,
        }
    }
}

impl<'a> Future for AcquireTimeout<'a> {
    type Output = Result<SemaphorePermit<'a>, AcquireTimeoutError>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: both fields are pinned with the whole, and never moved.
        let (acquire, sleep) = unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.acquire),
                Pin::new_unchecked(&mut this.sleep),
            )
        };
        replay::poll_until(acquire, sleep, cx)
    }
}

impl Logged for AcquireOp<'_> {
    type Output = Result<(), AcquireError>;

    const KEEPS: bool = true;

    fn stage(&self) -> Stage {
        match self.phase {
            Phase::New => Stage::New,
            // One that lets others run does so before it takes permits.
            Phase::GaveWay | Phase::Listed => Stage::Waits,
            Phase::Keeps => Stage::GaveWay,
            Phase::Over => Stage::Over,
        }
    }

    fn come(&mut self, turn: Turn, _: &mut Context<'_>) -> Poll<()> {
        if matches!(turn, Turn::Given(event) if event.stamp != 0) {
            self.semaphore.shared().take_given(self.count);
            self.phase = Phase::Keeps;
        }
        Poll::Ready(())
    }

    fn poll_unlogged(&mut self, cx: &mut Context<'_>) -> Poll<<Self as Logged>::Output> {
        self.poll_without_log(cx)
    }

    /// The stamp is taken now, when the process has the permits: it comes after what made room for
    /// them.
    unsafe fn success(&self, _: Option<&<Self as Logged>::Output>, _: u64) -> Event {
        Event::done(replay::own_stamp())
    }

    fn keep(&mut self, _: <Self as Logged>::Output) {
        self.phase = Phase::Keeps;
    }

    fn fail(&mut self, _: u64) -> Poll<<Self as Logged>::Output> {
        self.phase = Phase::Over;
        Poll::Ready(Err(AcquireError))
    }

    fn failure(output: &<Self as Logged>::Output) -> Option<Event> {
        output.as_ref().err().map(|_| replay::ended(true))
    }
}

impl<'a> GiveUp for AcquireOp<'a> {
    type Outcome = Result<SemaphorePermit<'a>, AcquireTimeoutError>;

    /// It has not tried yet.
    fn lets_others_run(&self) -> bool {
        self.phase == Phase::GaveWay
    }

    fn give_up(self: Pin<&mut Self>) -> Self::Outcome {
        self.give_up()
    }

    fn in_time(output: <Self as Future>::Output) -> Self::Outcome {
        output.map_err(AcquireTimeoutError::from)
    }

    fn failure_in_time(outcome: &Self::Outcome) -> Option<Event> {
        matches!(outcome, Err(AcquireTimeoutError::Timeout)).then(replay::gave_up)
    }
}
