//! Waiting at a condition, as a future.

use super::condition::Condvar;
use super::entry::{Cause, Entry, inheritor};
use super::error::LockError;
use super::guard::MutexGuard;
use super::mutex::Mutex;
use crate::finally::Finally;
use crate::replay::{self, Logged, Stage};
use crate::wait_point::WaitQueues;
use crate::waiter::Outcome;
use luna_core::current::{self, Inheritor, Renewal, WakeHandle};
use luna_core::events;
use luna_core::replay_log::{Event, Turn, What};
use luna_core::timer_queue::Sleep;
use luna_platform::clock::Instant;
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
    /// It has unlocked, and is not listed: by its process' replay log it is never notified, but
    /// locks again when it did.
    Unlocked,
    /// It holds the mutex, and has no entry.
    Keeps,
    Over,
}

/// Waiting at a condition: see [`Condvar::wait`].
///
/// # Invariants
///
/// In `Listed` it is pinned, and the entry was begun. Under the condition's lock its cause
/// determines which of the two locks guards the rest of it.
#[must_use = "an operation does nothing unless awaited, but that the mutex is unlocked when this is dropped"]
pub struct WaitOp<'c, 'a, T> {
    condition: &'c Condvar,
    mutex: &'a Mutex<T>,
    entry: UnsafeCell<Entry>,
    phase: Phase<'a, T>,
    /// The thread itself waits, so it may inherit.
    of_thread: bool,
    /// Its time ran out before it was notified.
    has_timed_out: bool,
    _pinned: PhantomPinned,
}

// SAFETY: a listed entry is guarded by locks wherever the future is; it leads to the value as
// `&mut T` does.
unsafe impl<T: Send> Send for WaitOp<'_, '_, T> {}
// SAFETY: `&WaitOp` gives access to nothing.
unsafe impl<T: Send> Sync for WaitOp<'_, '_, T> {}

impl<'c, 'a, T> WaitOp<'c, 'a, T> {
    pub(super) fn new(condition: &'c Condvar, guard: MutexGuard<'a, T>, of_thread: bool) -> Self {
        WaitOp {
            condition,
            mutex: guard.mutex(),
            entry: UnsafeCell::new(Entry::new()),
            phase: Phase::New(guard),
            of_thread,
            has_timed_out: false,
            _pinned: PhantomPinned,
        }
    }

    fn entry(&self) -> NonNull<Entry> {
        // SAFETY: a cell's address is never null.
        unsafe { NonNull::new_unchecked(self.entry.get()) }
    }

    /// Lists it, and unlocks the mutex after: every notifier from then on finds it.
    fn begin(&mut self, guard: MutexGuard<'a, T>, cx: &Context<'_>) {
        let inheritor = inheritor(self.of_thread);
        let priority = inheritor
            .as_ref()
            .map_or_else(current::priority, Inheritor::priority_before_blocking);
        let wake_handle = WakeHandle::of(cx);
        let entry = self.entry();
        self.condition.note_user(current::user());
        // SAFETY: the entry is this future's, which is pinned, takes it off before it goes, and
        // keeps the mutex by its handle.
        unsafe {
            Entry::begin(entry, self.mutex.core_pointer(), inheritor);
            let mut lists = self.condition.shared().wait_point.lock();
            Entry::set_ticket(entry, lists.tickets);
            lists
                .senders
                .insert(Entry::node(entry), priority, wake_handle);
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
        let mut renewal = Renewal::of(cx);
        let waits_here = renewal.put(|renewal| {
            let _lists = self.condition.shared().wait_point.lock();
            // SAFETY: the lock is held; without a cause the entry is in one of the condition's
            // lists, else it was moved to the mutex.
            unsafe {
                let waits_here = Entry::cause(entry) == Cause::None;
                if waits_here {
                    Entry::renew_wake_handle(entry, renewal);
                }
                waits_here
            }
        });
        if !waits_here {
            // SAFETY: the entry is this future's, and was moved there.
            return unsafe { self.mutex.core().poll_listed(entry, cx) };
        }
        self.condition.shared().wait_point.waits();
        Poll::Pending
    }

    /// Takes an entry that waits at the condition off its lists; returns whether it had been
    /// notified together with all others.
    ///
    /// # Safety
    ///
    /// `lists` are the condition's, and it has no cause.
    unsafe fn take_off(&self, lists: &mut WaitQueues) -> bool {
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
        let mut lists = this.condition.shared().wait_point.lock();
        // SAFETY: the lock is held, and under it the entry's cause determines its list.
        let admitted = unsafe {
            if Entry::cause(this.entry()) != Cause::None {
                return WaitTimeoutResult::NOTIFIED;
            }
            let (cause, result) = if this.take_off(&mut lists) {
                (Cause::NotifiedWithAll, WaitTimeoutResult::NOTIFIED)
            } else {
                this.has_timed_out = true;
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

    fn end(&mut self) {
        if let Phase::Listed = std::mem::replace(&mut self.phase, Phase::Over) {
            // SAFETY: it is this future's, was begun, and is settled or in no list.
            unsafe { Entry::end(self.entry()) };
        }
    }

    /// Gives up in any state. A notification that was for it alone is passed on; a mutex that it
    /// was handed is too.
    fn cancel(&mut self) {
        let entry = self.entry();
        self.condition.shared().wait_point.waits_no_more();
        let mut lists = self.condition.shared().wait_point.lock();
        // SAFETY: the lock is held; the entry's cause determines its list.
        unsafe {
            let cause = Entry::cause(entry);
            if cause == Cause::None {
                self.take_off(&mut lists);
                let _former = Entry::take_wake_handle(entry);
                drop(lists);
                self.end();
                return;
            }
            drop(lists);
            let (holds, _former) = self.mutex.core().withdraw(entry);
            self.end();
            let _passed_on = Finally::new(|| {
                if cause == Cause::NotifiedAlone {
                    self.condition.notify_one();
                }
            });
            if holds {
                // The value was not touched again.
                self.mutex.core().unlock(false);
            }
        }
    }
}

impl<'a, T> WaitOp<'_, 'a, T> {
    /// Polls until it holds the mutex again, or its branch has failed.
    fn poll_without_log(&mut self, cx: &Context<'_>) -> Poll<Result<(), LockError<'a, T>>> {
        match std::mem::replace(&mut self.phase, Phase::Over) {
            Phase::New(guard) if current::branch_failed() => {
                guard.unlock();
                current::stay_in_branch();
                Poll::Ready(Err(LockError::Poisoned))
            }
            Phase::New(guard) => {
                self.begin(guard, cx);
                self.condition.shared().wait_point.waits();
                Poll::Pending
            }
            Phase::Listed => {
                self.phase = Phase::Listed;
                if current::branch_failed() && !self.has_locked() {
                    self.cancel();
                    current::stay_in_branch();
                    return Poll::Ready(Err(LockError::Poisoned));
                }
                self.poll_listed(cx).map(Ok)
            }
            Phase::Keeps => {
                self.phase = Phase::Keeps;
                Poll::Ready(Ok(()))
            }
            Phase::Unlocked | Phase::Over => panic!("a wait was polled after it was over"),
        }
    }

    /// What the holder gets.
    fn locked(&mut self) -> Result<MutexGuard<'a, T>, LockError<'a, T>> {
        self.end();
        // SAFETY: it was taken, or handed to the entry.
        unsafe { self.mutex.held() }.map_err(LockError::OwnerDied)
    }
}

impl<'a, T> Future for WaitOp<'_, 'a, T> {
    type Output = Result<MutexGuard<'a, T>, LockError<'a, T>>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: nothing pinned is moved: a listed entry stays in its place.
        let this = unsafe { self.get_unchecked_mut() };
        let polled = match replay::is_on() {
            true => replay::poll(this, cx),
            false => this.poll_without_log(cx),
        };
        polled.map(|polled| polled.and_then(|()| this.locked()))
    }
}

impl<T> Drop for WaitOp<'_, '_, T> {
    fn drop(&mut self) {
        match self.phase {
            Phase::New(_) | Phase::Over => return,
            Phase::Listed => self.cancel(),
            Phase::Keeps => self.mutex.core().unlock(false),
            Phase::Unlocked => {}
        }
        replay::abandon(false);
    }
}

impl<T> fmt::Debug for WaitOp<'_, '_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.phase {
            Phase::New(_) => "WaitOp(New)",
            Phase::Listed => "WaitOp(Listed)",
            Phase::Unlocked => "WaitOp(Unlocked)",
            Phase::Keeps => "WaitOp(Keeps)",
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

/// Waiting at a condition until a deadline: see [`Condvar::wait_timeout`].
#[derive(Debug)]
#[must_use = "an operation does nothing unless awaited, but that the mutex is unlocked when this is dropped"]
pub struct WaitTimeout<'c, 'a, T> {
    wait: WaitOp<'c, 'a, T>,
    sleep: Sleep,
    /// What it was at the deadline, if that has come.
    result: Option<WaitTimeoutResult>,
}

impl<'c, 'a, T> WaitTimeout<'c, 'a, T> {
    pub(super) fn new(condition: &'c Condvar, guard: MutexGuard<'a, T>, deadline: Instant) -> Self {
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
        let may_be_late = polled.is_pending() && result.is_none() && !replay::is_replayed();
        if may_be_late && events::beside(|| sleep.poll(cx)).is_ready() {
            *result = Some(wait.as_mut().time_out());
            // It holds the mutex already if that was free.
            polled = wait.as_mut().poll(cx);
        }
        polled.map(|locked| Ok((locked?, WaitTimeoutResult(wait.has_timed_out))))
    }
}

/// A recorded wait has a stamp of its locking again; a replayed one locks when that comes, and its
/// former notifier need not notify again.
impl<'a, T> Logged for WaitOp<'_, 'a, T> {
    type Output = Result<(), LockError<'a, T>>;

    const KEEPS: bool = true;

    fn stage(&self) -> Stage {
        match self.phase {
            Phase::New(_) | Phase::Unlocked => Stage::New,
            Phase::Listed => Stage::Waits,
            Phase::Keeps => Stage::GaveWay,
            Phase::Over => Stage::Over,
        }
    }

    fn approach(&mut self) {
        if let Phase::New(_) = self.phase
            && replay::is_replayed()
            && let Phase::New(guard) = std::mem::replace(&mut self.phase, Phase::Unlocked)
        {
            guard.unlock();
        }
    }

    fn come(&mut self, turn: Turn, _: &mut Context<'_>) -> Poll<()> {
        match turn {
            Turn::Record => Poll::Ready(()),
            // It did not lock again.
            Turn::Look => Poll::Pending,
            Turn::Given(event) => {
                if self.mutex.core().take(inheritor(self.of_thread)).is_err() {
                    return replay::differs("another process holds the mutex");
                }
                self.has_timed_out = event.number == 1;
                self.phase = Phase::Keeps;
                Poll::Ready(())
            }
        }
    }

    fn poll_unlogged(&mut self, cx: &mut Context<'_>) -> Poll<<Self as Logged>::Output> {
        self.poll_without_log(cx)
    }

    unsafe fn success(&self, _: Option<&<Self as Logged>::Output>, _: u64) -> Event {
        let stamp = replay::meeting(&mut self.mutex.core().wait_point.lock());
        Event::new(What::Chosen, u64::from(self.has_timed_out), stamp)
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
