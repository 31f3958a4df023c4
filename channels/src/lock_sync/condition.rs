//! The condition variable.

use super::entry::{Cause, Entry};
use super::guard::LockError;
use super::guard::MutexGuard;
use super::wait::{WaitOp, WaitTimeout, WaitTimeoutResult};
use crate::finally::Finally;
use crate::guarded_wait_point::{GuardedWaitPoint, Locked};
use crate::inspect::WaitPointKind;
use crate::wait_point::{LastUser, Lists, WaitQueues};
use core::time::Duration;
use luna_core::current;
use luna_core::deferred_free::Shared;
use luna_core::wait_list::WaitList;
use luna_platform::clock::Instant;

/// Holders of a [`Mutex`](super::Mutex) that cannot go on yet wait here, until another process has
/// changed what the mutex guards, and notifies.
///
/// Clones are handles to the same condition. Waiting unlocks the mutex, and locks it again before
/// it returns; both in one step, so that no notification is lost in between. A notified waiter is
/// not woken to find the mutex locked, but moves to the waiters of the mutex, by priority; it is
/// woken when it holds the mutex. There are no spurious wakes: a wait returns when it was notified,
/// or its time ran out. A predicate that was true at the notification may be false again when the
/// waiter holds the mutex, if another holder was before it: use [`wait_while`](Self::wait_while).
///
/// Waiters may hold different mutexes. A notifier outside of the system that has not used the
/// condition yet is to be declared by [`external`](Self::external).
///
/// ```
/// use luna_channels::lock_sync::{Condvar, Mutex};
///
/// let (queue, filled) = (Mutex::new(Vec::new()), Condvar::new());
/// let (of_thread, fills) = (queue.clone(), filled.clone());
/// let thread = std::thread::spawn(move || {
///     of_thread.blocking_lock().unwrap().push(7);
///     fills.notify_one();
/// });
/// luna_core::block_on(async {
///     let guard = queue.lock().await.unwrap();
///     let mut guard = filled.wait_while(guard, |queue| queue.is_empty()).await.unwrap();
///     assert_eq!(guard.pop(), Some(7));
/// })
/// .unwrap();
/// thread.join().unwrap();
/// ```
///
/// # Invariants
///
/// A waiting entry is in the list of the waiting, and has the present number; or
/// it was notified together with all others, has an earlier number, and is in the list of the
/// notified until it is moved on. All nodes are entries that were begun.
#[derive(Clone)]
pub struct Condvar {
    shared: Shared<GuardedWaitPoint<Notified>>,
}

/// How often all were notified. Guarded by the condition's lock.
pub(super) struct Notified(pub(super) u32);

impl<L: Lists> Locked<'_, Notified, L> {
    /// Those that wait, by priority: under this name in the lists of any wait point.
    pub(super) fn waits(&mut self) -> &mut WaitList {
        &mut self.senders
    }

    /// Those that were notified together, and are to be moved on.
    pub(super) fn notified(&mut self) -> &mut WaitList {
        &mut self.held
    }
}

impl core::panic::UnwindSafe for Condvar {}
impl core::panic::RefUnwindSafe for Condvar {}

impl Condvar {
    /// A condition without waiters. Allocates; not for the real-time path.
    #[track_caller]
    #[expect(
        clippy::new_without_default,
        reason = "a default would be made at another place than where reports say"
    )]
    pub fn new() -> Condvar {
        Condvar {
            shared: GuardedWaitPoint::share(WaitPointKind::Condition, Notified(0)),
        }
    }

    pub(super) fn wait_point(&self) -> &GuardedWaitPoint<Notified> {
        &self.shared
    }

    /// Unlocks, waits to be notified, and locks again.
    ///
    /// Cancel-safe: dropped while it waits, it has not been notified, and does not hold the mutex.
    /// One that was notified alone passes the notification on to the next waiter. Real-time path:
    /// yes; no allocation, O(waiters of lower priority), and unlocking as when the
    /// [guard](MutexGuard) is dropped. It is listed at its present priority; when it moves to the
    /// mutex, at its priority then.
    ///
    /// # Errors
    ///
    /// As for [`Mutex::lock`](super::Mutex::lock). With [`LockError::Poisoned`] it does not hold
    /// the mutex.
    pub fn wait<'a, T>(&self, guard: MutexGuard<'a, T>) -> WaitOp<'_, 'a, T> {
        WaitOp::new(self, guard, false)
    }

    /// As [`wait`](Self::wait), repeated while `holds_up` returns true; that is asked first, so it
    /// may not wait at all.
    ///
    /// # Errors
    ///
    /// As for `wait`.
    pub async fn wait_while<'a, T>(
        &self,
        mut guard: MutexGuard<'a, T>,
        mut holds_up: impl FnMut(&mut T) -> bool,
    ) -> Result<MutexGuard<'a, T>, LockError<'a, T>> {
        while holds_up(&mut guard) {
            guard = self.wait(guard).await?;
        }
        Ok(guard)
    }

    /// As [`wait`](Self::wait), for at most `timeout`; then it locks again all the same, however
    /// long that takes. The result is exact: a wait that was notified, though it has not locked
    /// yet, has not timed out.
    ///
    /// # Errors
    ///
    /// As for `wait`.
    ///
    /// # Panics
    ///
    /// On a thread that runs no process of LUNA: there it has no timers.
    ///
    /// ```
    /// # use luna_channels::lock_sync::{Condvar, Mutex};
    /// # luna_core::block_on(async {
    /// let (mutex, never) = (Mutex::new(()), Condvar::new());
    /// let guard = mutex.lock().await.unwrap();
    /// let short = std::time::Duration::from_millis(1);
    /// let (guard, result) = never.wait_timeout(guard, short).await.unwrap();
    /// assert!(result.timed_out());
    /// # drop(guard);
    /// # }).unwrap();
    /// ```
    pub fn wait_timeout<'a, T>(
        &self,
        guard: MutexGuard<'a, T>,
        timeout: Duration,
    ) -> WaitTimeout<'_, 'a, T> {
        self.wait_deadline(guard, Instant::now() + timeout)
    }

    /// As [`wait_timeout`](Self::wait_timeout), until an absolute deadline.
    pub fn wait_deadline<'a, T>(
        &self,
        guard: MutexGuard<'a, T>,
        deadline: Instant,
    ) -> WaitTimeout<'_, 'a, T> {
        WaitTimeout::new(self, guard, deadline)
    }

    /// As [`wait`](Self::wait), blocking this thread. For plain threads and OS-thread processes.
    ///
    /// # Errors
    ///
    /// As for `wait`.
    ///
    /// # Panics
    ///
    /// In a process of an executor, which it would stop.
    #[cfg(not(loom))]
    #[track_caller]
    pub fn blocking_wait<'a, T>(
        &self,
        guard: MutexGuard<'a, T>,
    ) -> Result<MutexGuard<'a, T>, LockError<'a, T>> {
        luna_core::park::block_on(WaitOp::new(self, guard, true))
    }

    /// As [`blocking_wait`](Self::blocking_wait), for at most `timeout`: see
    /// [`wait_timeout`](Self::wait_timeout).
    ///
    /// # Errors
    ///
    /// As for `wait`.
    ///
    /// # Panics
    ///
    /// As for `blocking_wait`.
    ///
    /// ```
    /// # use luna_channels::lock_sync::{Condvar, Mutex};
    /// let (mutex, never) = (Mutex::new(()), Condvar::new());
    /// let guard = mutex.blocking_lock().unwrap();
    /// let short = std::time::Duration::from_millis(1);
    /// let (guard, result) = never.blocking_wait_timeout(guard, short).unwrap();
    /// assert!(result.timed_out());
    /// # drop(guard);
    /// ```
    #[cfg(not(loom))]
    #[track_caller]
    pub fn blocking_wait_timeout<'a, T>(
        &self,
        guard: MutexGuard<'a, T>,
        timeout: Duration,
    ) -> Result<(MutexGuard<'a, T>, WaitTimeoutResult), LockError<'a, T>> {
        use luna_core::park::{block_on, block_on_until};
        let mut wait = core::pin::pin!(WaitOp::new(self, guard, true));
        let guard = match block_on_until(wait.as_mut(), Instant::now() + timeout) {
            Some(locked) => locked?,
            None => {
                wait.as_mut().time_out();
                block_on(wait.as_mut())?
            }
        };
        Ok((guard, wait.timeout_result()))
    }

    /// Lets the most urgent waiter go on, as soon as it holds its mutex; of equals the first. Does
    /// nothing if there are no waiters.
    ///
    /// With or without the mutex locked. Real-time path: yes; O(waiters of lower priority for that
    /// mutex), a system call if the mutex is free and the thread of the notified waiter sleeps, or
    /// if the priority of a thread changes.
    pub fn notify_one(&self) {
        let mut locked = self.wait_point().lock();
        self.note_notifier(&mut locked);
        self.move_first(locked, Cause::NotifiedAlone);
    }

    /// Lets all present waiters go on, each as soon as it holds its mutex.
    ///
    /// Real-time path: yes; O(1) to fix the set of notified waiters, and then for each as for
    /// [`notify_one`](Self::notify_one), in a critical section of its own. The most urgent are
    /// moved on first.
    pub fn notify_all(&self) {
        let mut locked = self.wait_point().lock();
        self.note_notifier(&mut locked);
        let number = locked.state();
        number.0 = number.0.wrapping_add(1);
        let lists = &mut *locked;
        lists.held.append(&mut lists.senders);
        drop(locked);
        self.release();
    }

    /// Moves on the waiters that were notified together.
    fn release(&self) {
        loop {
            // A wake may panic: the remaining wakes must still be done.
            let rest = Finally::new(|| self.release());
            let locked = self.wait_point().lock();
            let is_over = !self.move_first(locked, Cause::NotifiedWithAll);
            rest.cancel();
            if is_over {
                return;
            }
        }
    }

    /// Moves the first of those that wait, or were notified together, to its mutex, for this cause.
    /// `false`: there is none.
    fn move_first(&self, mut locked: Locked<'_, Notified, impl Lists>, cause: Cause) -> bool {
        let list = match cause {
            Cause::NotifiedWithAll => locked.notified(),
            _ => locked.waits(),
        };
        let Some(entry) = list.pop().map(Entry::of) else {
            return false;
        };
        // SAFETY: the entry was just taken off the condition's list: its future cannot go without
        // the condition's lock before it is settled, and keeps its mutex. After that it may, so
        // that the reference keeps the mutex while its lock is held here.
        let (core, admitted) = unsafe {
            (*entry.as_ptr()).cause = cause;
            let core = (*entry.as_ptr()).core.clone();
            let admitted = core.admit(entry);
            (core, admitted)
        };
        drop(locked);
        admitted.carry_out();
        // Not under the condition's lock: it may be the last, and then its drop takes other locks.
        drop(core);
        true
    }

    fn note_notifier(&self, lists: &mut WaitQueues) {
        let user = current::user();
        lists.receiver = LastUser::of(user);
        self.wait_point().note_outsider(user);
    }

    /// Declares that a notifier is outside of the system: a plain thread, say. A process that waits
    /// here is then never part of a deadlock. A condition that an outside thread has used already
    /// is known to have such a user.
    #[must_use]
    pub fn external(self) -> Self {
        self.wait_point().identity.set_external();
        self
    }

    /// Names the condition in reports: see [`inspect`](crate::inspect). Not for the real-time path.
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        self.wait_point().identity.set_name(name);
        self
    }
}

luna_platform::debug_fields!(Condvar, |condvar| shared: &raw const *condvar.shared);
