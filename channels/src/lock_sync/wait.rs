//! Waiting at a condition, as a future.

use super::condition::Condition;
use super::entry::{Cause, Entry, inheritor};
use super::error::LockError;
use super::guard::MutexGuard;
use super::mutex::Mutex;
use crate::finally::Finally;
use crate::taped;
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
    /// It is replayed, and has unlocked: it is never notified, but the replay log has when it
    /// locked again.
    Replayed,
    /// It holds the mutex, and by its process' replay log must not continue yet. The entry was
    /// never begun.
    Keeps,
    Over,
}

/// Waiting at a condition: see [`Condition::wait`].
///
/// # Invariants
///
/// In `Listed` it is pinned, and the entry was begun. Under the condition's lock its cause
/// determines which of the two locks guards the rest of it.
#[must_use = "an operation does nothing unless awaited, but that the mutex is unlocked when this is dropped"]
pub struct WaitOp<'c, 'a, T> {
    condition: &'c Condition,
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
    pub(super) fn new(condition: &'c Condition, guard: MutexGuard<'a, T>, of_thread: bool) -> Self {
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
        let wakeup = WakeHandle::of(cx);
        let entry = self.entry();
        self.condition.note_user(current::user());
        // SAFETY: the entry is this future's, which is pinned, takes it off before it goes, and
        // keeps the mutex by its handle.
        unsafe {
            Entry::begin(entry, self.mutex.core_pointer(), inheritor);
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
        let mut renewal = Renewal::of(cx);
        let waits_here = renewal.put(|renewal| {
            let _lists = self.condition.shared().place.lock();
            // SAFETY: the lock is held; without a cause the entry is in one of the condition's
            // lists, else it was moved to the mutex.
            unsafe {
                let waits_here = Entry::cause(entry) == Cause::None;
                if waits_here {
                    Entry::renew_wakeup(entry, renewal);
                }
                waits_here
            }
        });
        if !waits_here {
            // SAFETY: the entry is this future's, and was moved there.
            return unsafe { self.mutex.core().poll_listed(entry, cx) };
        }
        self.condition.shared().place.waits();
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
        let mut lists = this.condition.shared().place.lock();
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

    /// Gives up in any state. A notification that was for it alone is passed on; a mutex that it
    /// was handed is too.
    fn cancel(&mut self) {
        let entry = self.entry();
        self.condition.shared().place.waits_no_more();
        let mut lists = self.condition.shared().place.lock();
        // SAFETY: the lock is held; the entry's cause determines its list.
        unsafe {
            let cause = Entry::cause(entry);
            if cause == Cause::None {
                self.take_off(&mut lists);
                let _former = Entry::take_wakeup(entry);
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
    fn poll_untaped(
        &mut self,
        cx: &Context<'_>,
    ) -> Poll<Result<MutexGuard<'a, T>, LockError<'a, T>>> {
        match std::mem::replace(&mut self.phase, Phase::Over) {
            Phase::New(guard) if current::branch_failed() => {
                guard.unlock();
                current::stay_in_branch();
                Poll::Ready(Err(LockError::Poisoned))
            }
            Phase::New(guard) => {
                self.begin(guard, cx);
                self.condition.shared().place.waits();
                Poll::Pending
            }
            Phase::Listed => {
                self.phase = Phase::Listed;
                if current::branch_failed() && !self.has_locked() {
                    self.cancel();
                    current::stay_in_branch();
                    return Poll::Ready(Err(LockError::Poisoned));
                }
                self.poll_listed(cx).map(|()| self.locked())
            }
            Phase::Replayed | Phase::Keeps | Phase::Over => {
                panic!("a wait was polled after it was over")
            }
        }
    }

    /// Polls as its process' replay log says. A recorded wait has a stamp of its locking again; a
    /// replayed one locks when that comes, and its former notifier need not notify again.
    #[cold]
    fn poll_taped(
        &mut self,
        cx: &mut Context<'_>,
    ) -> Poll<Result<MutexGuard<'a, T>, LockError<'a, T>>> {
        if let Phase::New(_) = self.phase
            && taped::is_replayed()
            && let Phase::New(guard) = std::mem::replace(&mut self.phase, Phase::Replayed)
        {
            guard.unlock();
        }
        if let Phase::Replayed = self.phase {
            match std::task::ready!(taped::enter(cx)) {
                Err(_) => {
                    self.phase = Phase::Over;
                    return Poll::Ready(Err(LockError::Poisoned));
                }
                Ok(Turn::Given(event)) => {
                    let inheritor = inheritor(self.of_thread);
                    if self.mutex.core().take(inheritor).is_err() {
                        current::tape(|tape| tape.differs("somebody else holds the mutex"));
                        return Poll::Pending;
                    }
                    self.has_timed_out = event.number == 1;
                    self.tell();
                    self.phase = Phase::Keeps;
                }
                // It did not lock again.
                Ok(_) => return Poll::Pending,
            }
        }
        if let Phase::Keeps = self.phase {
            if taped::is_held(cx) {
                return Poll::Pending;
            }
            self.phase = Phase::Over;
            // SAFETY: it was taken.
            return Poll::Ready(unsafe { self.mutex.held() }.map_err(LockError::OwnerDied));
        }
        let entered = taped::enter(cx);
        debug_assert!(entered.is_ready(), "who is recorded is let in");
        let polled = std::task::ready!(self.poll_untaped(cx));
        match &polled {
            Err(LockError::Poisoned) => taped::leave(Event::failed(taped::failure::POISONED)),
            _ => self.tell(),
        }
        Poll::Ready(polled)
    }

    /// Records that it has locked again.
    fn tell(&self) {
        let stamp = self
            .mutex
            .core()
            .place
            .lock()
            .stamp_if(true, taped::Stamped::Meeting);
        let number = u64::from(self.has_timed_out);
        taped::leave(Event::new(What::Chosen, number, stamp));
    }
}

impl<'a, T> Future for WaitOp<'_, 'a, T> {
    type Output = Result<MutexGuard<'a, T>, LockError<'a, T>>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: nothing pinned is moved: a listed entry stays in its place.
        let this = unsafe { self.get_unchecked_mut() };
        match current::is_taped() {
            true => this.poll_taped(cx),
            false => this.poll_untaped(cx),
        }
    }
}

impl<T> Drop for WaitOp<'_, '_, T> {
    fn drop(&mut self) {
        match self.phase {
            Phase::New(_) | Phase::Over => return,
            Phase::Listed => self.cancel(),
            Phase::Keeps => self.mutex.core().unlock(false),
            Phase::Replayed => {}
        }
        taped::abandoned();
    }
}

impl<T> fmt::Debug for WaitOp<'_, '_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.phase {
            Phase::New(_) => "WaitOp(New)",
            Phase::Listed => "WaitOp(Listed)",
            Phase::Replayed => "WaitOp(Replayed)",
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
        let may_be_late = result.is_none() && !taped::is_replayed();
        if polled.is_pending() && may_be_late && events::beside(|| sleep.poll(cx)).is_ready() {
            *result = Some(wait.as_mut().time_out());
            // It holds the mutex already if that was free.
            polled = wait.as_mut().poll(cx);
        }
        polled.map(|locked| Ok((locked?, WaitTimeoutResult(wait.has_timed_out))))
    }
}
