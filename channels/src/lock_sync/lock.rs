//! Locking a mutex, as a future.

use super::entry::{Entry, inheritor};
use super::error::{LockError, LockTimeoutError};
use super::guard::MutexGuard;
use super::mutex::Mutex;
use crate::replay::{self, GiveUp, Logged, Stage};
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
    /// It has let others run, and takes the lock next.
    GaveWay,
    /// The entry is in the mutex's list, or was settled.
    Listed,
    /// It holds the mutex, and has no entry.
    Keeps,
    Over,
}

/// Locking a mutex: see [`Mutex::lock`].
///
/// # Invariants
///
/// In `Listed` it is pinned, and the entry was begun.
#[must_use = "an operation does nothing unless awaited"]
pub struct LockOp<'a, T> {
    mutex: &'a Mutex<T>,
    entry: UnsafeCell<Entry>,
    phase: Phase,
    /// The thread itself locks, so it may inherit.
    of_thread: bool,
    _pinned: PhantomPinned,
}

// SAFETY: a listed entry is guarded by the mutex's lock wherever the future is; it leads to the
// value as `&mut T` does.
unsafe impl<T: Send> Send for LockOp<'_, T> {}
// SAFETY: `&LockOp` gives access to nothing.
unsafe impl<T: Send> Sync for LockOp<'_, T> {}

impl<'a, T> LockOp<'a, T> {
    pub(super) fn new(mutex: &'a Mutex<T>, of_thread: bool) -> Self {
        LockOp {
            mutex,
            entry: UnsafeCell::new(Entry::new()),
            phase: Phase::New,
            of_thread,
            _pinned: PhantomPinned,
        }
    }

    fn entry(&self) -> NonNull<Entry> {
        // SAFETY: a cell's address is never null.
        unsafe { NonNull::new_unchecked(self.entry.get()) }
    }

    #[inline(always)]
    fn poll_lock(&mut self, cx: &Context<'_>) -> Poll<()> {
        // Uncontended, there is no process to wake, and a thread need not ask the system for its
        // priority.
        match self.mutex.core().take(inheritor(self.of_thread)) {
            Ok(()) => Poll::Ready(()),
            Err(inheritor) => self.poll_contended(inheritor, cx),
        }
    }

    #[cold]
    fn poll_contended(&mut self, inheritor: Option<Inheritor>, cx: &Context<'_>) -> Poll<()> {
        if self.of_thread
            && let Some(inheritor) = &inheritor
        {
            // Not under the lock.
            inheritor.priority_before_blocking();
        }
        let mut renewal = Renewal::of(cx);
        // SAFETY: the entry is this future's, which is pinned; in `Listed` it is taken back and
        // ended when it goes.
        let polled = unsafe {
            let core = self.mutex.core();
            core.take_or_list(self.entry(), inheritor, &mut renewal)
        };
        // Before what is left of the renewal is dropped.
        self.phase = match polled {
            Poll::Ready(()) => Phase::Keeps,
            Poll::Pending => Phase::Listed,
        };
        polled
    }

    /// What the holder gets.
    fn locked(&mut self) -> Result<MutexGuard<'a, T>, LockError<'a, T>> {
        self.end();
        // SAFETY: it was taken, or handed to the entry.
        unsafe { self.mutex.held() }.map_err(LockError::OwnerDied)
    }

    fn end(&mut self) {
        if self.phase == Phase::Listed {
            // SAFETY: it is this future's, was begun, and is settled.
            unsafe { Entry::end(self.entry()) };
        }
        self.phase = Phase::Over;
    }

    /// Takes it back, if it waits; `true` if it holds the mutex.
    fn withdraw(&mut self) -> bool {
        if self.phase != Phase::Listed {
            return self.phase == Phase::Keeps;
        }
        // SAFETY: in `Listed` it is this future's, and was listed there.
        let (holds, _former) = unsafe { self.mutex.core().withdraw(self.entry()) };
        if !holds {
            self.end();
        }
        holds
    }

    /// At a deadline.
    pub(super) fn give_up(
        self: Pin<&mut Self>,
    ) -> Result<MutexGuard<'a, T>, LockTimeoutError<'a, T>> {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        if this.withdraw() {
            return this.locked().map_err(LockTimeoutError::from);
        }
        this.end();
        Err(LockTimeoutError::Timeout)
    }
}

impl<'a, T> LockOp<'a, T> {
    /// Polls until it holds the mutex, or its branch has failed.
    #[inline(always)]
    fn poll_without_log(&mut self, cx: &Context<'_>) -> Poll<Result<(), LockError<'a, T>>> {
        if current::branch_failed() && self.phase != Phase::Over && !self.withdraw() {
            if self.phase == Phase::New && crate::fails_later(cx) {
                self.phase = Phase::GaveWay;
                return Poll::Pending;
            }
            self.end();
            current::stay_in_branch();
            return Poll::Ready(Err(LockError::Poisoned));
        }
        let polled = match self.phase {
            // Lets others run before it holds a mutex that they could wait for.
            Phase::New if crate::gives_way(cx) => {
                self.phase = Phase::GaveWay;
                return Poll::Pending;
            }
            Phase::New | Phase::GaveWay => self.poll_lock(cx),
            // SAFETY: the entry is this future's, and was listed there.
            Phase::Listed => unsafe { self.mutex.core().poll_listed(self.entry(), cx) },
            Phase::Keeps => Poll::Ready(()),
            Phase::Over => panic!("a lock was polled after it was over"),
        };
        polled.map(Ok)
    }
}

impl<'a, T> Future for LockOp<'a, T> {
    type Output = Result<MutexGuard<'a, T>, LockError<'a, T>>;

    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: nothing pinned is moved: a listed entry stays in its place.
        let this = unsafe { self.get_unchecked_mut() };
        if this.phase == Phase::New
            && let Some(turn) = current::PlainTurn::of(cx)
            && this.mutex.core().take_fast(turn)
        {
            return Poll::Ready(this.locked());
        }
        this.poll_slow(cx)
    }
}

impl<'a, T> LockOp<'a, T> {
    /// Polls wherever the process is, and whatever it waits with.
    #[inline(never)]
    fn poll_slow(
        &mut self,
        cx: &mut Context<'_>,
    ) -> Poll<Result<MutexGuard<'a, T>, LockError<'a, T>>> {
        let polled = match replay::is_on() {
            true => replay::poll(self, cx),
            false => self.poll_without_log(cx),
        };
        polled.map(|polled| polled.and_then(|()| self.locked()))
    }
}

impl<T> Drop for LockOp<'_, T> {
    #[inline(always)]
    fn drop(&mut self) {
        if self.phase != Phase::Over {
            self.drop_unfinished();
        }
    }
}

impl<T> LockOp<'_, T> {
    #[cold]
    fn drop_unfinished(&mut self) {
        replay::abandon(self.phase == Phase::New);
        let holds = self.withdraw();
        self.end();
        if holds {
            // The value was not touched.
            self.mutex.core().unlock(false);
        }
    }
}

impl<T> fmt::Debug for LockOp<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LockOp")
            .field("phase", &self.phase)
            .finish_non_exhaustive()
    }
}

/// Locking a mutex until a deadline: see [`Mutex::lock_timeout`].
#[derive(Debug)]
#[must_use = "an operation does nothing unless awaited"]
pub struct LockTimeout<'a, T> {
    lock: LockOp<'a, T>,
    sleep: Sleep,
}

impl<'a, T> LockTimeout<'a, T> {
    pub(super) fn new(mutex: &'a Mutex<T>, sleep: Sleep) -> Self {
        LockTimeout {
            lock: mutex.lock(),
            sleep,
        }
    }
}

impl<'a, T> Future for LockTimeout<'a, T> {
    type Output = Result<MutexGuard<'a, T>, LockTimeoutError<'a, T>>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: both fields are pinned with the whole, and never moved.
        let (lock, sleep) = unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.lock),
                Pin::new_unchecked(&mut this.sleep),
            )
        };
        replay::poll_until(lock, sleep, cx)
    }
}

impl<'a, T> Logged for LockOp<'a, T> {
    type Output = Result<(), LockError<'a, T>>;

    const KEEPS: bool = true;

    fn stage(&self) -> Stage {
        match self.phase {
            Phase::New => Stage::New,
            // One that lets others run does so before it locks.
            Phase::GaveWay | Phase::Listed => Stage::Waits,
            Phase::Keeps => Stage::GaveWay,
            Phase::Over => Stage::Over,
        }
    }

    fn come(&mut self, _: Turn, _: &mut Context<'_>) -> Poll<()> {
        Poll::Ready(())
    }

    fn poll_unlogged(&mut self, cx: &mut Context<'_>) -> Poll<<Self as Logged>::Output> {
        self.poll_without_log(cx)
    }

    /// The stamp is taken now, when the process has the lock: stamps of holders are in the order of
    /// their holding it.
    unsafe fn success(&self, _: Option<&<Self as Logged>::Output>, _: u64) -> Event {
        Event::done(replay::meeting(&mut self.mutex.core().wait_point.lock()))
    }

    fn keep(&mut self, _: <Self as Logged>::Output) {
        self.end();
        self.phase = Phase::Keeps;
    }

    fn fail(&mut self, _: u64) -> Poll<<Self as Logged>::Output> {
        self.end();
        Poll::Ready(Err(LockError::Poisoned))
    }

    fn failure(output: &<Self as Logged>::Output) -> Option<Event> {
        output.as_ref().err().map(|_| replay::ended(true))
    }
}

impl<'a, T> GiveUp for LockOp<'a, T> {
    type Outcome = Result<MutexGuard<'a, T>, LockTimeoutError<'a, T>>;

    /// It has not tried yet.
    fn lets_others_run(&self) -> bool {
        self.phase == Phase::GaveWay
    }

    fn give_up(self: Pin<&mut Self>) -> Self::Outcome {
        self.give_up()
    }

    fn in_time(output: <Self as Future>::Output) -> Self::Outcome {
        output.map_err(LockTimeoutError::from)
    }

    fn failure_in_time(outcome: &Self::Outcome) -> Option<Event> {
        matches!(outcome, Err(LockTimeoutError::Timeout)).then(replay::gave_up)
    }
}
