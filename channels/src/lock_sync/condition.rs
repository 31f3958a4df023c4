//! The condition variable.

use super::core::{Admitted, CoreRef};
use super::entry::{Cause, Entry};
use super::error::LockError;
use super::guard::MutexGuard;
use super::wait::{WaitOp, WaitTimeout, WaitTimeoutResult};
use crate::finally::Finally;
use crate::inspect::{Identity, WaitPointKind, register, unregister};
use crate::wait_point::{AlignedWaitPoint, LastUser, WaitQueues};
use luna_core::current::{self, User};
use luna_core::deferred_free::{self, Retired};
use luna_core::wait_list::WaitNode;
use luna_platform::clock::Instant;
use luna_platform::sync::atomic::{AtomicUsize, Ordering};
use std::fmt;
use std::ptr::NonNull;
use std::time::Duration;

/// What the handles share.
///
/// # Invariants
///
/// A waiting entry is in the wait point's list of senders, and has the number `tickets`; or it was
/// notified together with all others, has an earlier number, and is in the list `held` until it is
/// moved on. All nodes are entries that were begun.
#[repr(C)]
pub(super) struct Shared {
    /// First, so that it leads back to this.
    retired: Retired,
    handles: AtomicUsize,
    pub(super) wait_point: AlignedWaitPoint,
}

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
/// luna_executors::block_on(async {
///     let guard = queue.lock().await.unwrap();
///     let mut guard = filled.wait_while(guard, |queue| queue.is_empty()).await.unwrap();
///     assert_eq!(guard.pop(), Some(7));
/// })
/// .unwrap();
/// thread.join().unwrap();
/// ```
pub struct Condvar {
    shared: NonNull<Shared>,
}

// SAFETY: what is shared is guarded by a lock, or atomic.
unsafe impl Send for Condvar {}
// SAFETY: as above.
unsafe impl Sync for Condvar {}
impl std::panic::UnwindSafe for Condvar {}
impl std::panic::RefUnwindSafe for Condvar {}

impl Condvar {
    /// A condition without waiters. Allocates; not for the real-time path.
    #[track_caller]
    #[expect(
        clippy::new_without_default,
        reason = "a default would be made at another place than where reports say"
    )]
    pub fn new() -> Condvar {
        let shared = NonNull::from(Box::leak(Box::new(Shared {
            retired: Retired::new(Shared::free),
            handles: AtomicUsize::new(1),
            wait_point: AlignedWaitPoint::new(Identity::new(WaitPointKind::Condition)),
        })));
        // SAFETY: it is live, and leaves the register in `free`.
        unsafe {
            register(NonNull::from(&*shared.as_ref().wait_point));
        };
        Condvar { shared }
    }

    pub(super) fn shared(&self) -> &Shared {
        // SAFETY: this handle keeps it alive.
        unsafe { self.shared.as_ref() }
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
    /// # luna_executors::block_on(async {
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
        let mut wait = std::pin::pin!(WaitOp::new(self, guard, true));
        if let Some(locked) = block_on_until(wait.as_mut(), Instant::now() + timeout) {
            return Ok((locked?, WaitTimeoutResult::NOTIFIED));
        }
        let result = wait.as_mut().time_out();
        Ok((block_on(wait)?, result))
    }

    /// Lets the most urgent waiter go on, as soon as it holds its mutex; of equals the first. Does
    /// nothing if there are no waiters.
    ///
    /// With or without the mutex locked. Real-time path: yes; O(waiters of lower priority for that
    /// mutex), a system call if the mutex is free and the thread of the notified waiter sleeps, or
    /// if the priority of a thread changes.
    pub fn notify_one(&self) {
        let mut lists = self.shared().wait_point.lock();
        self.note_notifier(&mut lists);
        let admitted = lists
            .senders
            .pop()
            // SAFETY: it was just taken off this condition's list; this thread holds the list's
            // lock.
            .and_then(|node| unsafe { move_on(node, Cause::NotifiedAlone) });
        drop(lists);
        if let Some((admitted, _mutex)) = admitted {
            admitted.carry_out();
        }
    }

    /// Lets all present waiters go on, each as soon as it holds its mutex.
    ///
    /// Real-time path: yes; O(1) to fix the set of notified waiters, and then for each as for
    /// [`notify_one`](Self::notify_one), in a critical section of its own. The most urgent are
    /// moved on first.
    pub fn notify_all(&self) {
        let mut guard = self.shared().wait_point.lock();
        self.note_notifier(&mut guard);
        let lists = &mut *guard;
        lists.held.append(&mut lists.senders);
        lists.tickets = lists.tickets.wrapping_add(1);
        drop(guard);
        self.release();
    }

    /// Moves on the waiters that were notified together.
    fn release(&self) {
        loop {
            let mut lists = self.shared().wait_point.lock();
            let Some(node) = lists.held.pop() else {
                return;
            };
            // SAFETY: as in `notify_one`.
            let admitted = unsafe { move_on(node, Cause::NotifiedWithAll) };
            drop(lists);
            // A wake may panic: the remaining wakes must still be done.
            let rest = Finally::new(|| self.release());
            if let Some((admitted, _mutex)) = admitted {
                admitted.carry_out();
            }
            rest.cancel();
        }
    }

    fn note_notifier(&self, lists: &mut WaitQueues) {
        let user = current::user();
        lists.receiver = LastUser::of(user);
        self.note_user(user);
    }

    /// Remembers that a user is outside of the system.
    pub(super) fn note_user(&self, user: User) {
        if user == User::Outside {
            self.shared().wait_point.identity.set_external();
        }
    }

    /// Declares that a notifier is outside of the system: a plain thread, say. A process that waits
    /// here is then never part of a deadlock. A condition that an outside thread has used already
    /// is known to have such a user.
    #[must_use]
    pub fn external(self) -> Self {
        self.shared().wait_point.identity.set_external();
        self
    }

    /// Names the condition in reports: see [`inspect`](crate::inspect). Not for the real-time path.
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        self.shared().wait_point.identity.set_name(name);
        self
    }
}

/// Moves a waiter to its mutex. The reference is to be dropped without the condition's lock: it may
/// be the last, and then its drop takes other locks.
///
/// # Safety
///
/// `node` was just taken off a condition's list, and this thread holds the list's lock.
unsafe fn move_on(node: NonNull<WaitNode>, cause: Cause) -> Option<(Admitted, CoreRef)> {
    // SAFETY: the contract: its future cannot go without the condition's lock before it is settled,
    // and keeps its mutex. After that it may, so that the reference keeps the mutex while its lock
    // is held here.
    unsafe {
        let entry = Entry::of(node);
        Entry::set_cause(entry, cause);
        let core = CoreRef::new(Entry::core(entry)?);
        let admitted = core.admit(entry);
        Some((admitted, core))
    }
}

impl Shared {
    /// # Safety
    ///
    /// As [`Retired`] requires.
    unsafe fn free(head: NonNull<Retired>) {
        // SAFETY: `Condvar::new` made it of a box, and the head is its first field.
        unsafe {
            let shared = head.cast::<Shared>();
            unregister(&shared.as_ref().wait_point);
            drop(Box::from_raw(shared.as_ptr()));
        }
    }
}

impl Clone for Condvar {
    fn clone(&self) -> Self {
        self.shared().handles.fetch_add(1, Ordering::Relaxed);
        Condvar {
            shared: self.shared,
        }
    }
}

impl Drop for Condvar {
    fn drop(&mut self) {
        if self.shared().handles.fetch_sub(1, Ordering::AcqRel) == 1 {
            // SAFETY: this was the last handle, and operations borrow theirs.
            unsafe { deferred_free::retire(self.shared.cast()) };
        }
    }
}

impl fmt::Debug for Condvar {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Condvar")
            .field("shared", &self.shared)
            .finish_non_exhaustive()
    }
}
