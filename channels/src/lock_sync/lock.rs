//! Locking a mutex, as a future.

use super::entry::{Entry, heir};
use super::error::{LockError, LockTimeoutError};
use super::guard::MutexGuard;
use super::mutex::Mutex;
use crate::taped::{self, Locking};
use luna_platform::clock::Instant;
use luna_platform::current;
use luna_platform::timer_queue::Sleep;
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
    /// It holds the mutex, and is not to go on yet, by its process' tape.
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
    taped: Locking,
    /// The thread itself locks, so it may inherit.
    of_thread: bool,
    _pinned: PhantomPinned,
}

// SAFETY: a listed entry is guarded by the mutex's lock wherever the future is; it leads to the value as `&mut T` does.
unsafe impl<T: Send> Send for LockOp<'_, T> {}
// SAFETY: `&LockOp` gives access to nothing.
unsafe impl<T: Send> Sync for LockOp<'_, T> {}

impl<'a, T> LockOp<'a, T> {
    pub(super) fn new(mutex: &'a Mutex<T>, of_thread: bool) -> Self {
        LockOp {
            mutex,
            entry: UnsafeCell::new(Entry::new()),
            phase: Phase::New,
            taped: Locking::New,
            of_thread,
            _pinned: PhantomPinned,
        }
    }

    fn entry(&self) -> NonNull<Entry> {
        // SAFETY: a cell's address is never null.
        unsafe { NonNull::new_unchecked(self.entry.get()) }
    }

    fn poll_lock(&mut self, cx: &Context<'_>) -> Poll<()> {
        let mut heir = heir(self.of_thread);
        if self.of_thread {
            // Uncontended, a thread need not ask the system for its priority; contended, not under the lock.
            match self.mutex.core().take(heir) {
                Ok(()) => return Poll::Ready(()),
                Err(back) => heir = back,
            }
            if let Some(heir) = &heir {
                heir.priority_before_blocking();
            }
        }
        // SAFETY: the entry is this future's, which is pinned; in `Listed` it is taken back and ended when it goes.
        unsafe { self.mutex.core().take_or_list(self.entry(), heir, cx) }
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
        // SAFETY: in `Listed` it is this future's, and was listed there.
        self.phase == Phase::Keeps
            || self.phase == Phase::Listed && unsafe { self.mutex.core().withdraw(self.entry()) }
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

impl<'a, T> Future for LockOp<'a, T> {
    type Output = Result<MutexGuard<'a, T>, LockError<'a, T>>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: nothing pinned is moved: a listed entry stays in its place.
        let this = unsafe { self.get_unchecked_mut() };
        if current::branch_failed() && this.phase != Phase::Over && !this.withdraw() {
            this.end();
            current::stay_in_branch();
            return Poll::Ready(Err(LockError::Poisoned));
        }
        if current::is_taped() && taped::waits_to_lock(cx, &mut this.taped) {
            return Poll::Pending;
        }
        let polled = match this.phase {
            // Lets others run before it holds anything that they could wait for.
            Phase::New if crate::gives_way(cx) => {
                this.phase = Phase::GaveWay;
                return Poll::Pending;
            }
            Phase::New | Phase::GaveWay => {
                let polled = this.poll_lock(cx);
                if polled.is_pending() {
                    this.phase = Phase::Listed;
                }
                polled
            }
            // SAFETY: the entry is this future's, and was listed there.
            Phase::Listed => unsafe { this.mutex.core().poll_listed(this.entry(), cx) },
            Phase::Keeps if taped::is_held(cx) => return Poll::Pending,
            Phase::Keeps => Poll::Ready(()),
            Phase::Over => panic!("a lock was polled after it was over"),
        };
        if polled.is_ready() && this.phase != Phase::Keeps && current::is_taped() {
            taped::has_waited_to_lock(&this.mutex.core().place, false);
            if taped::is_held(cx) {
                this.end();
                this.phase = Phase::Keeps;
                return Poll::Pending;
            }
        }
        polled.map(|()| this.locked())
    }
}

impl<T> Drop for LockOp<'_, T> {
    fn drop(&mut self) {
        let holds = self.withdraw();
        self.end();
        if holds {
            // It has not come to touch the value.
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
    pub(super) fn new(mutex: &'a Mutex<T>, deadline: Instant) -> Self {
        LockTimeout {
            lock: mutex.lock(),
            sleep: Sleep::until(deadline),
        }
    }
}

impl<'a, T> Future for LockTimeout<'a, T> {
    type Output = Result<MutexGuard<'a, T>, LockTimeoutError<'a, T>>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: both fields are pinned with the whole, and never moved.
        let (mut lock, sleep) = unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.lock),
                Pin::new_unchecked(&mut this.sleep),
            )
        };
        let is_new = lock.phase == Phase::New && lock.taped == Locking::New;
        if taped::has_no_time_to_lock(cx, is_new) {
            return Poll::Ready(lock.give_up());
        }
        if let Poll::Ready(locked) = lock.as_mut().poll(cx) {
            return Poll::Ready(locked.map_err(LockTimeoutError::from));
        }
        // One that lets others run has not tried yet.
        if lock.phase == Phase::GaveWay {
            return Poll::Pending;
        }
        if taped::is_replayed() {
            return Poll::Pending;
        }
        match sleep.poll(cx) {
            Poll::Ready(()) => {
                let outcome = lock.as_mut().give_up();
                if current::is_taped() {
                    taped::has_waited_to_lock(&lock.mutex.core().place, outcome.is_err());
                }
                Poll::Ready(outcome)
            }
            Poll::Pending => Poll::Pending,
        }
    }
}
