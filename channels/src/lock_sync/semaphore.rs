//! The counting semaphore, and permits that were taken.

use super::core::Core;
use super::guard::{AcquireError, AcquireTimeoutError};
use super::take::Take;
#[cfg(not(loom))]
use super::taking::Permits;
use super::taking::{AcquireOp, AcquireTimeout};
use crate::inspect::WaitPointKind;
use crate::replay;
use core::mem::ManuallyDrop;
use core::time::Duration;
use luna_core::current;
use luna_core::deferred_free::Shared;
use luna_core::timer_queue::Sleep;
use luna_platform::clock::Instant;

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
/// # luna_core::block_on(async {
/// let motors = Semaphore::new(2); // the supply stands two that start at a time
/// let first = motors.acquire().await?;
/// let _second = motors.acquire().await?;
/// assert!(motors.try_acquire().is_none());
/// drop(first);
/// assert_eq!(motors.available_permits(), 1);
/// # Ok::<(), luna_channels::lock_sync::AcquireError>(())
/// # }).unwrap().unwrap();
/// ```
#[derive(Clone)]
pub struct Semaphore {
    core: Shared<Core>,
}

impl core::panic::UnwindSafe for Semaphore {}
impl core::panic::RefUnwindSafe for Semaphore {}

impl Semaphore {
    /// A semaphore with `permits`. Allocates; not for the real-time path.
    #[track_caller]
    pub fn new(permits: u32) -> Semaphore {
        Semaphore {
            core: Core::with_permits(WaitPointKind::Semaphore, permits),
        }
    }

    pub(super) fn core(&self) -> &Core {
        &self.core
    }

    #[inline]
    pub(super) fn take(&self, count: u32, of_thread: bool) -> Take<'_> {
        Take::new(&self.core, count, of_thread)
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
    /// # luna_core::block_on(async {
    /// let semaphore = Semaphore::new(3);
    /// let permits = semaphore.acquire_many(3).await.unwrap();
    /// assert_eq!((permits.num_permits(), semaphore.available_permits()), (3, 0));
    /// # drop(permits);
    /// # }).unwrap();
    /// ```
    #[inline]
    pub fn acquire_many(&self, count: u32) -> AcquireOp<'_> {
        AcquireOp {
            of: self,
            take: self.take(count, false),
        }
    }

    /// Takes a permit, if there is one and no waiter is as urgent. O(1), for the real-time path.
    pub fn try_acquire(&self) -> Option<SemaphorePermit<'_>> {
        self.try_acquire_many(1)
    }

    /// Takes `count` permits, if there are so many and no waiter is as urgent. O(1), for the
    /// real-time path.
    pub fn try_acquire_many(&self, count: u32) -> Option<SemaphorePermit<'_>> {
        let taken = self.core().try_take(count);
        taken.map(|_| SemaphorePermit::taken(self, count))
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
    /// # luna_core::block_on(async {
    /// let short = std::time::Duration::from_millis(1);
    /// let late = Semaphore::new(0).acquire_timeout(short).await.is_err();
    /// assert!(late);
    /// # }).unwrap();
    /// ```
    pub fn acquire_timeout(&self, timeout: Duration) -> AcquireTimeout<'_> {
        self.acquire().until(Sleep::after(timeout))
    }

    /// Like [`acquire_timeout`](Self::acquire_timeout), until an absolute deadline.
    pub fn acquire_deadline(&self, deadline: Instant) -> AcquireTimeout<'_> {
        self.acquire().until(Sleep::until(deadline))
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
        self.taken(1, luna_core::park::block_on(self.take(1, true)))
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
        self.taken_in_time(1, replay::block_for(self.take(1, true), timeout))
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
        self.core().note_user(luna_core::current::Here::now());
        self.core().give_back(count);
    }

    /// Number of free permits: for display, since it may have changed already.
    pub fn available_permits(&self) -> u64 {
        match current::has_replay_log() {
            true => replay::look(|| self.core().permits()),
            false => self.core().permits(),
        }
    }

    /// Declares that permits are also added from outside of the system: by a plain thread, say. A
    /// process that waits here is then never part of a deadlock. A semaphore that an outside thread
    /// has used already is known to have such a user.
    #[must_use]
    pub fn external(self) -> Self {
        self.core().identity.set_external();
        self
    }

    /// Names the semaphore in reports: see [`inspect`](crate::inspect). Not for the real-time path.
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        self.core().identity.set_name(name);
        self
    }
}

luna_platform::debug_fields!(Semaphore, |semaphore| shared: &raw const *semaphore.core);

/// Permits of a [`Semaphore`], which are given back when this is dropped: O(waiters served by
/// them), for the real-time path.
///
/// They may be kept across awaits, and be sent to another process or thread.
///
/// ```
/// use luna_channels::lock_sync::Semaphore;
///
/// let semaphore = Semaphore::new(2);
/// semaphore.try_acquire().unwrap().forget(); // for good
/// assert_eq!(semaphore.available_permits(), 1);
/// ```
#[derive(Debug)]
#[must_use = "the permits are given back when this is dropped"]
pub struct SemaphorePermit<'a> {
    semaphore: &'a Semaphore,
    count: u32,
}

impl<'a> SemaphorePermit<'a> {
    /// So many that the caller has taken, and gives away.
    pub(super) fn taken(semaphore: &'a Semaphore, count: u32) -> Self {
        Self { semaphore, count }
    }

    /// How many they are.
    pub fn num_permits(&self) -> u32 {
        self.count
    }

    /// Does not give them back: the semaphore has so many less from now on.
    pub fn forget(self) {
        let _ = ManuallyDrop::new(self);
    }
}

impl Drop for SemaphorePermit<'_> {
    fn drop(&mut self) {
        self.semaphore.core().give_back(self.count);
    }
}
