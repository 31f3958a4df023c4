//! The counting semaphore.

use super::acquire::{AcquireOp, AcquireTimeout};
use super::error::{AcquireError, AcquireTimeoutError};
use super::permit::SemaphorePermit;
use crate::finally::Finally;
use crate::inspect::{Identity, WaitPointKind, register, unregister};
use crate::replay;
use crate::wait_point::{AlignedWaitPoint, LastUser, WaitQueues};
use crate::waiter::{Outcome, Waiter};
use luna_core::current::{self, Priority, User};
use luna_core::deferred_free::{self, Retired};
use luna_core::timer_queue::Sleep;
use luna_platform::clock::Instant;
use luna_platform::sync::UnsafeCell;
use luna_platform::sync::atomic::{AtomicUsize, Ordering};
use std::fmt;
use std::ptr::NonNull;
use std::time::Duration;

/// What the handles share.
///
/// # Invariants
///
/// `permits` is accessed under the lock of `wait_point` alone. Waiters are in its list of senders;
/// all its nodes are waiters of `()`, with the number of wanted permits as the ticket.
#[repr(C)]
pub(super) struct Shared {
    /// First, so that it leads back to this.
    retired: Retired,
    handles: AtomicUsize,
    pub(super) wait_point: AlignedWaitPoint,
    permits: UnsafeCell<u64>,
}

/// A number of permits, to limit how many processes do something at a time. For processes of all
/// kinds and plain threads.
///
/// Clones are handles to the same semaphore. The most urgent waiter is served first, of equals the
/// first. A waiter that wants more permits than are there blocks those behind it, so that a large
/// request does not starve. A newcomer takes permits past the waiters only if it is more urgent
/// than all of them.
///
/// A semaphore has no owner, so no priority is inherited: a process that may add permits need not
/// hold any. Where that matters use a [`Mutex`](super::Mutex).
///
/// ```
/// use luna_channels::lock_sync::Semaphore;
/// # luna_executors::block_on(async {
/// let motors = Semaphore::new(2); // the supply stands two that start at a time
/// let first = motors.acquire().await?;
/// let _second = motors.acquire().await?;
/// assert!(motors.try_acquire().is_none());
/// drop(first);
/// assert_eq!(motors.available_permits(), 1);
/// # Ok::<(), luna_channels::lock_sync::AcquireError>(())
/// # }).unwrap().unwrap();
/// ```
pub struct Semaphore {
    shared: NonNull<Shared>,
}

// SAFETY: what is shared is guarded by a lock, or atomic.
unsafe impl Send for Semaphore {}
// SAFETY: as above.
unsafe impl Sync for Semaphore {}
impl std::panic::UnwindSafe for Semaphore {}
impl std::panic::RefUnwindSafe for Semaphore {}

impl Semaphore {
    /// A semaphore with `permits`. Allocates; not for the real-time path.
    #[track_caller]
    pub fn new(permits: u32) -> Semaphore {
        let shared = NonNull::from(Box::leak(Box::new(Shared {
            retired: Retired::new(Shared::free),
            handles: AtomicUsize::new(1),
            wait_point: AlignedWaitPoint::new(Identity::new(WaitPointKind::Semaphore)),
            permits: UnsafeCell::new(u64::from(permits)),
        })));
        // SAFETY: it is live, and leaves the register in `free`.
        unsafe {
            register(NonNull::from(&*shared.as_ref().wait_point));
        };
        Semaphore { shared }
    }

    pub(super) fn shared(&self) -> &Shared {
        // SAFETY: this handle keeps it alive.
        unsafe { self.shared.as_ref() }
    }

    /// Takes a permit, waiting until there is one for the caller.
    ///
    /// A scheduling point: more urgent processes that are ready on the executor run first.
    /// Cancel-safe: dropped while it waits, it has taken none; one that was just given its permit
    /// gives it back. Real-time path: yes; no allocation, O(1), or O(waiters of lower priority) to
    /// wait.
    ///
    /// # Errors
    ///
    /// [`AcquireError`] in a branch of a parallel construct after a sibling has failed.
    #[inline]
    pub fn acquire(&self) -> AcquireOp<'_> {
        self.acquire_many(1)
    }

    /// Takes `count` permits at once, waiting until there are so many for the caller. If there
    /// never are, it waits for ever, and so do those behind it. See [`acquire`](Self::acquire).
    ///
    /// ```
    /// # use luna_channels::lock_sync::Semaphore;
    /// # luna_executors::block_on(async {
    /// let semaphore = Semaphore::new(3);
    /// let permits = semaphore.acquire_many(3).await.unwrap();
    /// assert_eq!((permits.num_permits(), semaphore.available_permits()), (3, 0));
    /// # drop(permits);
    /// # }).unwrap();
    /// ```
    #[inline]
    pub fn acquire_many(&self, count: u32) -> AcquireOp<'_> {
        AcquireOp::new(self, count, false)
    }

    /// Takes a permit, if there is one and no waiter is as urgent. O(1), for the real-time path.
    pub fn try_acquire(&self) -> Option<SemaphorePermit<'_>> {
        self.try_acquire_many(1)
    }

    /// Takes `count` permits, if there are so many and no waiter is as urgent. O(1), for the
    /// real-time path.
    pub fn try_acquire_many(&self, count: u32) -> Option<SemaphorePermit<'_>> {
        let take = || {
            self.shared().note_user(current::user());
            let mut lists = self.shared().wait_point.lock();
            self.shared().take(&mut lists, count, current::priority())
        };
        let has_taken = match current::has_replay_log() {
            // Without a stamp: a replay need not wait for the process that makes room.
            true => replay::call(
                false,
                || match current::is_replayed() {
                    true => self.shared().take_given(count),
                    false => take(),
                },
                |taken| (!taken).then_some(replay::failure::NOTHING),
            )
            .unwrap_or_default(),
            false => take(),
        };
        // SAFETY: they were taken.
        has_taken.then(|| unsafe { SemaphorePermit::new(self, count) })
    }

    /// Like [`acquire`](Self::acquire), for at most `timeout` from its first poll on. Exact: it
    /// times out only if it has taken none. One that need not wait does not read the clock.
    ///
    /// # Panics
    ///
    /// When it has to wait on a thread that runs no process of LUNA: there it has no timers.
    ///
    /// ```
    /// # use luna_channels::lock_sync::Semaphore;
    /// # luna_executors::block_on(async {
    /// let short = std::time::Duration::from_millis(1);
    /// let late = Semaphore::new(0).acquire_timeout(short).await.is_err();
    /// assert!(late);
    /// # }).unwrap();
    /// ```
    pub fn acquire_timeout(&self, timeout: Duration) -> AcquireTimeout<'_> {
        AcquireTimeout::new(self, Sleep::after(timeout))
    }

    /// Like [`acquire_timeout`](Self::acquire_timeout), until an absolute deadline.
    pub fn acquire_deadline(&self, deadline: Instant) -> AcquireTimeout<'_> {
        AcquireTimeout::new(self, Sleep::until(deadline))
    }

    /// Like [`acquire`](Self::acquire), blocking this thread. For plain threads and OS-thread
    /// processes. A plain thread waits at its own OS priority, as with
    /// [`Mutex::blocking_lock`](super::Mutex::blocking_lock).
    ///
    /// # Errors
    ///
    /// As for `acquire`.
    ///
    /// # Panics
    ///
    /// In a process of an executor, which it would stop.
    #[cfg(not(loom))]
    #[track_caller]
    pub fn blocking_acquire(&self) -> Result<SemaphorePermit<'_>, AcquireError> {
        luna_core::park::block_on(AcquireOp::new(self, 1, true))
    }

    /// Like [`blocking_acquire`](Self::blocking_acquire), for at most `timeout`.
    ///
    /// # Errors
    ///
    /// [`AcquireTimeoutError`].
    ///
    /// # Panics
    ///
    /// As for `blocking_acquire`.
    ///
    /// ```
    /// # use luna_channels::lock_sync::Semaphore;
    /// let none = Semaphore::new(0);
    /// let late = none.blocking_acquire_timeout(std::time::Duration::from_millis(1));
    /// assert!(late.unwrap_err().is_timeout());
    /// ```
    #[cfg(not(loom))]
    #[track_caller]
    pub fn blocking_acquire_timeout(
        &self,
        timeout: Duration,
    ) -> Result<SemaphorePermit<'_>, AcquireTimeoutError> {
        let mut acquire = std::pin::pin!(AcquireOp::new(self, 1, true));
        match luna_core::park::block_on_until(acquire.as_mut(), Instant::now() + timeout) {
            Some(acquired) => acquired.map_err(AcquireTimeoutError::from),
            None => acquire.give_up(),
        }
    }

    /// Makes `count` more permits. Real-time path: yes; O(waiters served by them), each in a lock
    /// section of its own, and a system call for each with a sleeping thread.
    ///
    /// ```
    /// let semaphore = luna_channels::lock_sync::Semaphore::new(0);
    /// semaphore.add_permits(2);
    /// assert_eq!(semaphore.available_permits(), 2);
    /// ```
    pub fn add_permits(&self, count: u32) {
        self.shared().note_user(current::user());
        self.shared().add(count);
    }

    /// Number of free permits: for display, since it may have changed already.
    pub fn available_permits(&self) -> u64 {
        let look = || {
            let lists = self.shared().wait_point.lock();
            self.shared().permits(&lists, |permits| *permits)
        };
        match current::has_replay_log() {
            true => replay::look(look),
            false => look(),
        }
    }

    /// Declares that permits are also added from outside of the system: by a plain thread, say. A
    /// process that waits here is then never part of a deadlock. A semaphore that an outside thread
    /// has used already is known to have such a user.
    #[must_use]
    pub fn external(self) -> Self {
        self.shared().wait_point.identity.set_external();
        self
    }

    /// Names the semaphore in reports: see [`inspect`](crate::inspect). Not for the real-time path.
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        self.shared().wait_point.identity.set_name(name);
        self
    }
}

impl Shared {
    fn permits<R>(&self, _lists: &WaitQueues, f: impl FnOnce(&mut u64) -> R) -> R {
        // SAFETY: the lists show that the lock is held, and `f` cannot come here again, since it
        // gets no lists.
        self.permits.with_mut(|permits| f(unsafe { &mut *permits }))
    }

    /// Remembers that a user is outside of the system.
    pub(super) fn note_user(&self, user: User) {
        if user == User::Outside {
            self.wait_point.identity.set_external();
        }
    }

    /// Takes permits for a caller of this priority, unless they are not there, or a waiter is as
    /// urgent.
    pub(super) fn take(&self, lists: &mut WaitQueues, count: u32, priority: Priority) -> bool {
        let first = lists.senders.first();
        // SAFETY: a listed node is live, and the lock is held.
        let is_first = first.is_none_or(|first| priority > unsafe { first.as_ref() }.priority());
        let taken = is_first
            && self.permits(lists, |permits| {
                let left = permits.checked_sub(u64::from(count));
                left.map(|left| *permits = left).is_some()
            });
        if taken {
            lists.receiver = LastUser::of(current::user());
        }
        taken
    }

    /// Takes permits in a replay, where the recorded process got some. The process that made room
    /// for them may do so a little later, since what it does at once after that may have to wait;
    /// so their number is not tested, and may be below 0 for a while.
    #[cold]
    pub(super) fn take_given(&self, count: u32) -> bool {
        let lists = self.wait_point.lock();
        self.permits(&lists, |permits| {
            *permits = permits.wrapping_sub(u64::from(count));
        });
        true
    }

    /// Makes more permits, and serves the waiters.
    pub(super) fn add(&self, count: u32) {
        let mut lists = self.wait_point.lock();
        self.permits(&lists, |permits| {
            *permits = match replay::is_replayed() {
                true => permits.wrapping_add(u64::from(count)),
                false => permits.saturating_add(u64::from(count)),
            };
        });
        while self.serve_first(lists) {
            lists = self.wait_point.lock();
        }
    }

    /// Serves waiters, as far as the permits go.
    pub(super) fn serve(&self) {
        while self.serve_first(self.wait_point.lock()) {}
    }

    /// Serves the first waiter, if there are enough permits.
    fn serve_first(&self, mut lists: luna_core::biased_lock::BiasedGuard<'_, WaitQueues>) -> bool {
        let Some(node) = lists.senders.first() else {
            return false;
        };
        let waiter = node.cast::<Waiter<()>>();
        // SAFETY: a listed node is a live waiter, and the lock is held; it is settled as it leaves
        // the list.
        let ready = unsafe {
            let wanted = u64::from((*Waiter::link(waiter)).ticket);
            let left = self.permits(&lists, |permits| permits.checked_sub(wanted));
            let Some(left) = left else {
                return false;
            };
            self.permits(&lists, |permits| *permits = left);
            lists.receiver = LastUser::of(node.as_ref().user());
            lists.senders.remove(node);
            Waiter::settle(waiter, Outcome::Done)
        };
        drop(lists);
        // A wake may panic: the remaining wakes must still be done.
        let rest = Finally::new(|| self.serve());
        ready.wake();
        rest.cancel();
        true
    }

    /// # Safety
    ///
    /// As [`Retired`] requires.
    unsafe fn free(head: NonNull<Retired>) {
        // SAFETY: `Semaphore::new` made it of a box, and the head is its first field.
        unsafe {
            let shared = head.cast::<Shared>();
            unregister(&shared.as_ref().wait_point);
            drop(Box::from_raw(shared.as_ptr()));
        }
    }
}

impl Clone for Semaphore {
    fn clone(&self) -> Self {
        self.shared().handles.fetch_add(1, Ordering::Relaxed);
        Semaphore {
            shared: self.shared,
        }
    }
}

impl Drop for Semaphore {
    fn drop(&mut self) {
        if self.shared().handles.fetch_sub(1, Ordering::AcqRel) == 1 {
            // SAFETY: this was the last handle, and operations and permits borrow theirs.
            unsafe { deferred_free::retire(self.shared.cast()) };
        }
    }
}

impl fmt::Debug for Semaphore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Semaphore")
            .field("shared", &self.shared)
            .finish_non_exhaustive()
    }
}
