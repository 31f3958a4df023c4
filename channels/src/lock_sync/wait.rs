//! Waiting at a condition, as a future.

use super::condition::{Condvar, Notified};
use super::core::Hold;
use super::entry::{Cause, Entry};
use super::guard::MutexGuard;
use super::guard::{AcquireError, LockError};
use super::mutex::Mutex;
use super::take::{self, Take, TakePhase};
use super::taking::Permits;
use crate::finally::Finally;
use crate::guarded_wait_point::Locked;
use crate::in_place::InPlace;
use crate::replay::{self, Logged, Stage};
use crate::wait_point::Lists;
use core::fmt;
use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll, ready};
use luna_core::current::{self, Renewal, WakeHandle};
use luna_core::events;
use luna_core::replay_log::{Event, Turn, What};
use luna_core::timer_queue::Sleep;
use luna_platform::clock::Instant;
use pin_project_lite::pin_project;

/// Waiting at a condition: see [`Condvar::wait`].
///
/// Unlocking comes first: `guard` is there until then. What follows is a take of the mutex,
/// which is begun in the list of the condition, and moved to that of the mutex by a notifier. Its
/// phase `GaveWay` means here that it has unlocked, and is not listed. In a replay it is never
/// notified: it locks again when the recorded wait did.
///
/// # Invariants
///
/// Under the condition's lock the cause of an entry that was begun determines which of the two
/// locks guards the rest of it.
#[must_use = "an operation does nothing unless awaited, but that the mutex is unlocked when this is dropped"]
pub struct WaitOp<'c, 'a, T> {
    condition: &'c Condvar,
    mutex: &'a Mutex<T>,
    guard: Option<MutexGuard<'a, T>>,
    take: Take<'a>,
    /// Its time ran out before it was notified.
    has_timed_out: bool,
}

// SAFETY: a shared reference gives no access to the guard, and so none to its value.
unsafe impl<T: Send> Sync for WaitOp<'_, '_, T> {}

// SAFETY: what is pinned is the entry in `take`, which every method leaves where it is.
unsafe impl<T> InPlace for WaitOp<'_, '_, T> {}

impl<'c, 'a, T> WaitOp<'c, 'a, T> {
    pub(super) fn new(condition: &'c Condvar, guard: MutexGuard<'a, T>, of_thread: bool) -> Self {
        let mutex = guard.mutex();
        WaitOp {
            condition,
            mutex,
            guard: Some(guard),
            take: mutex.take(of_thread),
            has_timed_out: false,
        }
    }

    /// Lists it, and unlocks the mutex after: every notifier from then on finds it.
    fn begin(&mut self, guard: MutexGuard<'a, T>, cx: &Context<'_>) {
        let priority = take::priority(self.take.of_thread);
        let inheritor = take::caller(self.take.of_thread);
        let wake_handle = WakeHandle::of(cx);
        let entry = self.take.entry();
        self.condition.wait_point().note_outsider(current::user());
        // SAFETY: the entry is this future's, which is pinned, takes it off before it goes, and
        // keeps the mutex by its handle.
        unsafe {
            self.take.begin(inheritor);
            let mut locked = self.condition.wait_point().lock();
            (*Entry::link(entry)).ticket = locked.state().0;
            let node = Entry::node(entry);
            locked.waits().insert(node, priority, wake_handle);
        }
        guard.unlock();
    }

    fn poll_listed(&mut self, cx: &Context<'_>) -> Poll<()> {
        let entry = self.take.entry();
        let mut renewal = Renewal::of(cx);
        let waits_here = renewal.put(|renewal| {
            let _lists = self.condition.wait_point().lock();
            // SAFETY: the lock is held; without a cause the entry is in one of the condition's
            // lists, else it was moved to the mutex.
            unsafe {
                let waits_here = (*entry.as_ptr()).cause == Cause::None;
                if waits_here {
                    renewal.store((*Entry::link(entry)).wait.wake_handle_mut());
                }
                waits_here
            }
        });
        if !waits_here {
            return self.take.poll_listed(cx);
        }
        self.condition.wait_point().waits();
        Poll::Pending
    }

    /// Takes an entry that waits at the condition off its lists; returns whether it had been
    /// notified together with all others.
    ///
    /// # Safety
    ///
    /// `locked` is the condition's, and the entry has no cause.
    unsafe fn take_off(&self, locked: &mut Locked<'_, Notified, impl Lists>) -> bool {
        let node = Entry::node(self.take.entry());
        // SAFETY: the condition's lock is held, and the entry has no cause, as is demanded here: so
        // it is in one of its lists, and by the condition's invariant its number says in which.
        unsafe {
            let was_notified = (*Entry::link(self.take.entry())).ticket != locked.state().0;
            match was_notified {
                true => locked.notified().remove(node),
                false => locked.waits().remove(node),
            }
            was_notified
        }
    }

    /// At a deadline: it waits for the mutex alone from now on, unless it was notified before.
    pub(super) fn time_out(self: Pin<&mut Self>) {
        let this = self.in_place();
        if this.take.phase != TakePhase::Listed {
            // A replayed wait is listed nowhere.
            return;
        }
        let entry = this.take.entry();
        let mut locked = this.condition.wait_point().lock();
        // SAFETY: the lock is held, and under it the entry's cause determines its list. This
        // future's handle keeps the mutex.
        let admitted = unsafe {
            if (*entry.as_ptr()).cause != Cause::None {
                return;
            }
            this.has_timed_out = !this.take_off(&mut locked);
            (*entry.as_ptr()).cause = match this.has_timed_out {
                true => Cause::TimedOut,
                false => Cause::NotifiedWithAll,
            };
            this.mutex.core().admit(entry)
        };
        drop(locked);
        admitted.carry_out();
    }

    pub(super) fn timeout_result(&self) -> WaitTimeoutResult {
        WaitTimeoutResult(self.has_timed_out)
    }

    /// Gives up while it waits at the condition or for the mutex. A notification that was for it
    /// alone is passed on; a mutex that it was handed is too.
    fn cancel(&mut self) {
        let entry = self.take.entry();
        self.condition.wait_point().waits_no_more();
        let mut locked = self.condition.wait_point().lock();
        // SAFETY: the lock is held; the entry's cause determines its list.
        let (cause, _former) = unsafe {
            let cause = (*entry.as_ptr()).cause;
            let former = (cause == Cause::None).then(|| {
                self.take_off(&mut locked);
                (*Entry::link(entry)).wait.wake_handle_mut().take()
            });
            (cause, former)
        };
        drop(locked);
        if cause == Cause::None {
            return self.take.end();
        }
        let _passed_on = Finally::new(|| {
            if cause == Cause::NotifiedAlone {
                self.condition.notify_one();
            }
        });
        self.take.cancel();
    }
}

impl<'a, T> Future for WaitOp<'_, 'a, T> {
    type Output = Result<MutexGuard<'a, T>, LockError<'a, T>>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.in_place();
        replay::poll(this, cx).map(|taken| {
            this.take.end();
            this.mutex.taken(1, taken)
        })
    }
}

impl<T> Drop for WaitOp<'_, '_, T> {
    fn drop(&mut self) {
        if self.guard.is_some() {
            // Dropping the guard is all.
            self.take.end();
        } else if self.take.phase == TakePhase::Listed {
            self.cancel();
            replay::abandon(false);
        }
    }
}

impl<T> fmt::Debug for WaitOp<'_, '_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("WaitOp").field(&self.take).finish()
    }
}

/// Whether a wait with a timeout ended by that.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WaitTimeoutResult(bool);

impl WaitTimeoutResult {
    /// Whether the time ran out before it was notified.
    pub fn timed_out(self) -> bool {
        self.0
    }
}

pin_project! {
    /// Waiting at a condition until a deadline: see [`Condvar::wait_timeout`].
    #[derive(Debug)]
    #[must_use = "an operation does nothing unless awaited, but that the mutex is unlocked when this is dropped"]
    pub struct WaitTimeout<'c, 'a, T> {
        #[pin]
        wait: WaitOp<'c, 'a, T>,
        #[pin]
        sleep: Sleep,
        is_late: bool,
    }
}

impl<'c, 'a, T> WaitTimeout<'c, 'a, T> {
    pub(super) fn new(condition: &'c Condvar, guard: MutexGuard<'a, T>, deadline: Instant) -> Self {
        WaitTimeout {
            wait: condition.wait(guard),
            sleep: Sleep::until(deadline),
            is_late: false,
        }
    }
}

impl<'a, T> Future for WaitTimeout<'_, 'a, T> {
    type Output = Result<(MutexGuard<'a, T>, WaitTimeoutResult), LockError<'a, T>>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.project();
        let mut wait = this.wait;
        let mut polled = wait.as_mut().poll(cx);
        let may_be_late = polled.is_pending() && !*this.is_late && !replay::is_replayed();
        if may_be_late && events::beside(|| this.sleep.poll(cx)).is_ready() {
            *this.is_late = true;
            wait.as_mut().time_out();
            // It holds the mutex already if that was free.
            polled = wait.as_mut().poll(cx);
        }
        polled.map(|locked| Ok((locked?, wait.timeout_result())))
    }
}

/// A recorded wait has a stamp of its locking again; a replayed one locks when that comes, and its
/// former notifier need not notify again.
impl<'a, T> Logged for WaitOp<'_, 'a, T> {
    type Output = Result<Hold<'a>, AcquireError>;

    const KEEPS: bool = true;

    fn stage(&self) -> Stage {
        match self.take.phase {
            // It has not come back from unlocking.
            TakePhase::GaveWay => Stage::New,
            _ => self.take.stage(),
        }
    }

    fn approach(&mut self) {
        if replay::is_replayed()
            && let Some(guard) = self.guard.take()
        {
            self.take.phase = TakePhase::GaveWay;
            guard.unlock();
        }
    }

    fn come(&mut self, turn: Turn, _: &mut Context<'_>) -> Poll<()> {
        match turn {
            Turn::Record => Poll::Ready(()),
            // It did not lock again.
            Turn::Look => Poll::Pending,
            Turn::Given(event) => {
                let mut inheritor = take::caller(self.take.of_thread);
                let here = current::Here::now();
                if !self.mutex.core().take(here, 1, || inheritor.take()) {
                    return replay::differs("another process holds the mutex");
                }
                self.has_timed_out = event.number == 1;
                self.take.phase = TakePhase::Granted;
                Poll::Ready(())
            }
        }
    }

    fn poll_unlogged(&mut self, cx: &mut Context<'_>) -> Poll<<Self as Logged>::Output> {
        let has_failed = current::branch_failed();
        if let Some(guard) = self.guard.take() {
            if has_failed {
                guard.unlock();
                self.take.end();
                current::stay_in_branch();
                return Poll::Ready(Err(AcquireError));
            }
            self.begin(guard, cx);
            self.condition.wait_point().waits();
            return Poll::Pending;
        }
        match self.take.phase {
            TakePhase::Listed if self.take.has_succeeded() => {}
            TakePhase::Listed if has_failed => {
                self.cancel();
                current::stay_in_branch();
                return Poll::Ready(Err(AcquireError));
            }
            TakePhase::Listed => ready!(self.poll_listed(cx)),
            TakePhase::Granted => {}
            TakePhase::New | TakePhase::GaveWay | TakePhase::Over => {
                panic!("a wait was polled after it was over")
            }
        }
        // SAFETY: it has succeeded; it is over when this is returned.
        Poll::Ready(Ok(unsafe { self.take.hold() }))
    }

    unsafe fn success(&self, _: Option<&<Self as Logged>::Output>, _: u64) -> Event {
        let stamp = replay::meeting(&mut self.mutex.core().lock());
        Event::new(What::Chosen, u64::from(self.has_timed_out), stamp)
    }

    fn keep(&mut self, output: <Self as Logged>::Output) {
        self.take.keep(output);
    }

    fn fail(&mut self, number: u64) -> Poll<<Self as Logged>::Output> {
        self.take.fail(number)
    }

    fn failure(output: &<Self as Logged>::Output) -> Option<Event> {
        Take::failure(output)
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use std::sync::{Arc, LazyLock};
    use std::task::{Wake, Waker};

    type Timed = Pin<Box<WaitOp<'static, 'static, ()>>>;

    /// The wait whose time runs out when another one is woken.
    static TIMED: std::sync::Mutex<Option<Timed>> = std::sync::Mutex::new(None);

    struct RunsOut;

    impl Wake for RunsOut {
        fn wake(self: Arc<Self>) {
            let mut timed = TIMED.lock().unwrap();
            timed.as_mut().expect("it waits").as_mut().time_out();
        }
    }

    #[test]
    fn a_time_that_runs_out_within_notify_all_counts_as_notified() {
        static SHARED: LazyLock<(Condvar, [Mutex<()>; 2])> =
            LazyLock::new(|| (Condvar::new(), [Mutex::new(()), Mutex::new(())]));
        let (condition, mutexes) = &*SHARED;
        let [mut first, mut timed] = mutexes
            .each_ref()
            .map(|mutex| Box::pin(condition.wait(mutex.try_lock().unwrap())));
        let runs_out = Waker::from(Arc::new(RunsOut));
        let polled = first.as_mut().poll(&mut Context::from_waker(&runs_out));
        assert!(polled.is_pending());
        let noop = &mut Context::from_waker(Waker::noop());
        assert!(timed.as_mut().poll(noop).is_pending());
        *TIMED.lock().unwrap() = Some(timed);
        // The first is moved to its mutex, and woken, before the other one is moved on.
        condition.notify_all();
        let mut timed = TIMED.lock().unwrap().take().unwrap();
        assert!(timed.as_mut().poll(noop).is_ready());
        assert!(!timed.timeout_result().timed_out());
        assert!(first.as_mut().poll(noop).is_ready());
    }
}
