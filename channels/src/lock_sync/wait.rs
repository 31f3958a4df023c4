//! Waiting at a condition, as a future.

use super::condition::Condition;
use super::entry::{Cause, Entry, heir};
use super::error::LockError;
use super::guard::MutexGuard;
use super::mutex::Mutex;
use crate::place::Lists;
use crate::waiter::Outcome;
use luna_platform::clock::Instant;
use luna_platform::current::{self, Heir, Wakeup};
use luna_platform::timer_queue::Sleep;
use std::cell::UnsafeCell;
use std::fmt;
use std::future::Future;
use std::marker::PhantomPinned;
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll};

enum Phase<'a, T> {
    /// It still holds the mutex.
    New(MutexGuard<'a, T>),
    /// The entry is in a list of the condition, or of the mutex, or was settled.
    Listed,
    Over,
}

/// Waiting at a condition: see [`Condition::wait`].
///
/// # Invariants
///
/// In `Listed` it is pinned, and the entry was begun. Under the condition's lock its cause says which of the two locks guards the rest of it.
#[must_use = "an operation does nothing unless awaited, but that the mutex is unlocked when this is dropped"]
pub struct WaitOp<'c, 'a, T> {
    condition: &'c Condition,
    mutex: &'a Mutex<T>,
    entry: UnsafeCell<Entry>,
    phase: Phase<'a, T>,
    /// The thread itself waits, so it may inherit.
    of_thread: bool,
    _pinned: PhantomPinned,
}

// SAFETY: a listed entry is guarded by locks wherever the future is; it leads to the value as `&mut T` does.
unsafe impl<T: Send> Send for WaitOp<'_, '_, T> {}
// SAFETY: `&WaitOp` gives access to nothing.
unsafe impl<T: Send> Sync for WaitOp<'_, '_, T> {}

impl<'c, 'a, T> WaitOp<'c, 'a, T> {
    pub(super) fn new(condition: &'c Condition, guard: MutexGuard<'a, T>, of_thread: bool) -> Self {
        WaitOp {
            condition,
            mutex: guard.mutex(),
            entry: UnsafeCell::new(Entry::new()),
            phase: Phase::New(guard),
            of_thread,
            _pinned: PhantomPinned,
        }
    }

    fn entry(&self) -> NonNull<Entry> {
        // SAFETY: a cell's address is never null.
        unsafe { NonNull::new_unchecked(self.entry.get()) }
    }

    /// Lists it, and unlocks the mutex after: whoever notifies from then on finds it.
    fn begin(&mut self, guard: MutexGuard<'a, T>, cx: &Context<'_>) {
        let heir = heir(self.of_thread);
        let priority = heir
            .as_ref()
            .map_or_else(current::priority, Heir::priority_before_blocking);
        let wakeup = Wakeup::of(cx);
        let entry = self.entry();
        self.condition.note_user(current::user());
        // SAFETY: the entry is this future's, which is pinned, takes it off before it goes, and keeps the mutex by its handle.
        unsafe {
            Entry::begin(entry, self.mutex.core_pointer(), heir);
            let mut lists = self.condition.shared().place.lock();
            Entry::set_ticket(entry, lists.tickets);
            lists.senders.insert(Entry::node(entry), priority, wakeup);
        }
        self.phase = Phase::Listed;
        guard.unlock();
    }

    fn has_locked(&self) -> bool {
        // SAFETY: asked in `Listed`.
        unsafe { Entry::outcome(self.entry()) == Outcome::Done }
    }

    fn poll_listed(&mut self, cx: &Context<'_>) -> Poll<()> {
        if self.has_locked() {
            return Poll::Ready(());
        }
        let entry = self.entry();
        let lists = self.condition.shared().place.lock();
        // SAFETY: the lock is held; without a cause the entry is in one of the condition's lists, else it was moved to the mutex.
        unsafe {
            if Entry::cause(entry) != Cause::None {
                drop(lists);
                return self.mutex.core().poll_listed(entry, cx);
            }
            let former = Entry::set_wakeup(entry, cx);
            drop(lists);
            drop(former);
        }
        Poll::Pending
    }

    /// Takes one that waits at the condition off its lists; says whether it had been notified together with all others.
    ///
    /// # Safety
    ///
    /// `lists` are the condition's, and it has no cause.
    unsafe fn take_off(&self, lists: &mut Lists) -> bool {
        // SAFETY: the contract, and the condition's invariant.
        unsafe {
            let was_notified = Entry::ticket(self.entry()) != lists.tickets;
            if was_notified {
                lists.held.remove(Entry::node(self.entry()));
            } else {
                lists.senders.remove(Entry::node(self.entry()));
            }
            was_notified
        }
    }

    /// At a deadline: it waits for the mutex alone from now on, unless it was notified before.
    pub(super) fn time_out(self: Pin<&mut Self>) -> WaitTimeoutResult {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        let mut lists = this.condition.shared().place.lock();
        // SAFETY: the lock is held, under which the entry is where its cause says.
        let admitted = unsafe {
            if Entry::cause(this.entry()) != Cause::None {
                return WaitTimeoutResult::NOTIFIED;
            }
            let (cause, result) = if this.take_off(&mut lists) {
                (Cause::NotifiedWithAll, WaitTimeoutResult::NOTIFIED)
            } else {
                (Cause::TimedOut, WaitTimeoutResult::TIMED_OUT)
            };
            Entry::set_cause(this.entry(), cause);
            // This future's handle keeps the mutex.
            (this.mutex.core().admit(this.entry()), result)
        };
        drop(lists);
        admitted.0.carry_out();
        admitted.1
    }

    /// What the holder gets.
    fn locked(&mut self) -> Result<MutexGuard<'a, T>, LockError<'a, T>> {
        self.end();
        // SAFETY: it was handed to the entry.
        unsafe { self.mutex.held() }.map_err(LockError::OwnerDied)
    }

    fn end(&mut self) {
        // SAFETY: it is this future's, was begun, and is settled or in no list.
        unsafe { Entry::end(self.entry()) };
        self.phase = Phase::Over;
    }

    /// Gives up, wherever it is. A notification that was for it alone is passed on; a mutex that it was handed is too.
    fn cancel(&mut self) {
        let entry = self.entry();
        let mut lists = self.condition.shared().place.lock();
        // SAFETY: the lock is held; the entry is where its cause says.
        unsafe {
            let cause = Entry::cause(entry);
            if cause == Cause::None {
                self.take_off(&mut lists);
                let former = Entry::take_wakeup(entry);
                drop(lists);
                drop(former);
                self.end();
                return;
            }
            drop(lists);
            let holds = self.mutex.core().withdraw(entry);
            self.end();
            if holds {
                // It has not come to touch the value again.
                self.mutex.core().unlock(false);
            }
            if cause == Cause::NotifiedAlone {
                self.condition.notify_one();
            }
        }
    }
}

impl<'a, T> Future for WaitOp<'_, 'a, T> {
    type Output = Result<MutexGuard<'a, T>, LockError<'a, T>>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: nothing pinned is moved: a listed entry stays in its place.
        let this = unsafe { self.get_unchecked_mut() };
        match std::mem::replace(&mut this.phase, Phase::Over) {
            Phase::New(guard) if current::branch_failed() => {
                guard.unlock();
                current::stay_in_branch();
                Poll::Ready(Err(LockError::Poisoned))
            }
            Phase::New(guard) => {
                this.begin(guard, cx);
                Poll::Pending
            }
            Phase::Listed => {
                this.phase = Phase::Listed;
                if current::branch_failed() && !this.has_locked() {
                    this.cancel();
                    current::stay_in_branch();
                    return Poll::Ready(Err(LockError::Poisoned));
                }
                this.poll_listed(cx).map(|()| this.locked())
            }
            Phase::Over => panic!("a wait was polled after it was over"),
        }
    }
}

impl<T> Drop for WaitOp<'_, '_, T> {
    fn drop(&mut self) {
        if matches!(self.phase, Phase::Listed) {
            self.cancel();
        }
    }
}

impl<T> fmt::Debug for WaitOp<'_, '_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.phase {
            Phase::New(_) => "WaitOp(New)",
            Phase::Listed => "WaitOp(Listed)",
            Phase::Over => "WaitOp(Over)",
        })
    }
}

/// Whether a wait with a timeout ended by that.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WaitTimeoutResult(bool);

impl WaitTimeoutResult {
    pub(super) const NOTIFIED: WaitTimeoutResult = WaitTimeoutResult(false);
    const TIMED_OUT: WaitTimeoutResult = WaitTimeoutResult(true);

    /// Whether the time ran out before it was notified.
    pub fn timed_out(self) -> bool {
        self.0
    }
}

/// Waiting at a condition until a deadline: see [`Condition::wait_timeout`].
#[derive(Debug)]
#[must_use = "an operation does nothing unless awaited, but that the mutex is unlocked when this is dropped"]
pub struct WaitTimeout<'c, 'a, T> {
    wait: WaitOp<'c, 'a, T>,
    sleep: Sleep,
    /// What it was at the deadline, if that has come.
    result: Option<WaitTimeoutResult>,
}

impl<'c, 'a, T> WaitTimeout<'c, 'a, T> {
    pub(super) fn new(
        condition: &'c Condition,
        guard: MutexGuard<'a, T>,
        deadline: Instant,
    ) -> Self {
        WaitTimeout {
            wait: condition.wait(guard),
            sleep: Sleep::until(deadline),
            result: None,
        }
    }
}

impl<'a, T> Future for WaitTimeout<'_, 'a, T> {
    type Output = Result<(MutexGuard<'a, T>, WaitTimeoutResult), LockError<'a, T>>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: both fields are pinned with the whole, and never moved.
        let (mut wait, sleep, result) = unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.wait),
                Pin::new_unchecked(&mut this.sleep),
                &mut this.result,
            )
        };
        let mut polled = wait.as_mut().poll(cx);
        if polled.is_pending() && result.is_none() && sleep.poll(cx).is_ready() {
            *result = Some(wait.as_mut().time_out());
            // It holds the mutex already if that was free.
            polled = wait.as_mut().poll(cx);
        }
        polled.map(|locked| Ok((locked?, result.unwrap_or(WaitTimeoutResult::NOTIFIED))))
    }
}
