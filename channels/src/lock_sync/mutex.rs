//! The mutex itself.

use super::core::{Core, Hold};
use super::guard::{LockError, LockTimeoutError, TryLockError};
use super::guard::{MutexGuard, OwnerDied};
use super::take::Take;
#[cfg(not(loom))]
use super::taking::Permits;
use super::taking::{LockOp, LockTimeout};
use crate::inspect::WaitPointKind;
#[cfg(not(loom))]
use crate::replay;
use core::mem::ManuallyDrop;
use core::time::Duration;
use luna_core::deferred_free::Shared;
use luna_core::timer_queue::Sleep;
use luna_platform::clock::Instant;
use luna_platform::sync::UnsafeCell;
use luna_platform::sync::atomic::{AtomicUsize, Ordering};
use luna_platform::sync::plain::AtomicBool;

/// A value for use by one process or thread at a time: a process of an executor, an OS-thread
/// process, a task of another runtime, or a plain thread.
///
/// Clones are handles to the same mutex, so it needs no `Arc`; the value is dropped with the last
/// one. [`lock`](Self::lock) suspends a process, not its executor; the [`MutexGuard`] unlocks by
/// scope, and may be held across awaits. The mutex is handed over directly to the most urgent
/// waiter, of equals to the first: no process barges in.
///
/// **Priority inheritance.** The holder inherits the priority of its waiters until it unlocks: the
/// level on its executor, and the OS priority of its thread, if that is above. A holder that waits
/// for another mutex passes it on, along up to 8 holders. One that holds several falls to the
/// highest of what remains. A plain thread that locks by [`blocking_lock`](Self::blocking_lock) or
/// [`try_lock`](Self::try_lock) is boosted by the kernel, and set back; a task of another runtime
/// that awaits [`lock`](Self::lock) is not, since it has no thread of its own. A process that is
/// boosted while it is ready is moved up in its executor's queue. A branch of `pri_par!` that holds
/// a mutex runs as far below its process as it ever does.
///
/// **Robust.** If its holder panics or is cancelled in the middle, the next one learns of it:
/// [`OwnerDied`].
///
/// A process that locks a mutex which it holds already waits for ever. It is not refused: another
/// of its branches, or a process that it sent the guard to, may be the one to unlock. The deadlock
/// report names it.
///
/// For what goes from one process to another, use a channel.
///
/// ```
/// use luna_channels::lock_sync::Mutex;
///
/// let total = Mutex::new(0);
/// let of_thread = total.clone();
/// let thread = std::thread::spawn(move || *of_thread.blocking_lock().unwrap() += 1);
/// luna_core::block_on(async { *total.lock().await.unwrap() += 1 }).unwrap();
/// thread.join().unwrap();
/// assert_eq!(*total.try_lock().unwrap(), 2);
/// ```
pub struct Mutex<T> {
    core: Shared<Core>,
    value: Shared<Value<T>>,
}

/// The guarded value.
///
/// # Invariants
///
/// `value` is accessed by the holder of the mutex, and dropped with the last handle. `has_died` is
/// accessed by the holder.
struct Value<T> {
    handles: AtomicUsize,
    /// A former holder has died while it held the mutex, and none has recovered it.
    has_died: AtomicBool,
    value: UnsafeCell<ManuallyDrop<T>>,
}

// SAFETY: only the holder of the mutex accesses the value, one at a time; the count and
// the mark are atomics.
unsafe impl<T: Send> Sync for Value<T> {}
// What a panic leaves half done is marked.
impl<T> core::panic::UnwindSafe for Mutex<T> {}
impl<T> core::panic::RefUnwindSafe for Mutex<T> {}

impl<T: Send> Mutex<T> {
    /// An unlocked mutex around `value`. Allocates; not for the real-time path.
    #[track_caller]
    pub fn new(value: T) -> Mutex<T> {
        let value = Value {
            handles: AtomicUsize::new(1),
            has_died: AtomicBool::new(false),
            value: UnsafeCell::new(ManuallyDrop::new(value)),
        };
        Mutex {
            core: Core::with_permits(WaitPointKind::Mutex, 1),
            // SAFETY: the drop of what is `ManuallyDrop` does nothing.
            value: unsafe { Shared::borrowing(value) },
        }
    }
}

impl<T> Mutex<T> {
    #[inline]
    pub(super) fn core(&self) -> &Core {
        &self.core
    }

    #[inline]
    pub(super) fn take(&self, of_thread: bool) -> Take<'_> {
        Take::new(&self.core, 1, of_thread)
    }

    #[inline]
    pub(super) fn value(&self) -> &UnsafeCell<ManuallyDrop<T>> {
        &self.value.value
    }

    /// Said by the holder.
    pub(super) fn set_died(&self, has_died: bool) {
        // Relaxed, here and below: the lock, or the outcome of a node, comes in between.
        self.value.has_died.store(has_died, Ordering::Relaxed);
    }

    /// Locks, waiting until the holder and all more urgent waiters have unlocked.
    ///
    /// A scheduling point: more urgent processes that are ready on the executor run first.
    /// Cancel-safe: dropped while it waits, it has not locked; one that was just handed the mutex
    /// passes it on. Real-time path: yes; no allocation, O(1) if the mutex is free, else O(waiters
    /// of lower priority), a system call if that raises a thread's OS priority, and the chain as
    /// [above](Mutex).
    ///
    /// # Errors
    ///
    /// [`LockError::OwnerDied`], which holds the mutex; [`LockError::Poisoned`] in a branch of a
    /// parallel construct after a sibling has failed.
    #[inline]
    pub fn lock(&self) -> LockOp<'_, T> {
        LockOp {
            of: self,
            take: Take::new(&self.core, 1, false),
        }
    }

    /// Locks, if the mutex is free. O(1), for the real-time path. On a plain thread, the first call
    /// allocates the thread's record.
    ///
    /// # Errors
    ///
    /// [`TryLockError::Locked`], or [`TryLockError::OwnerDied`], which holds the mutex.
    ///
    /// ```
    /// let mutex = luna_channels::lock_sync::Mutex::new(());
    /// let guard = mutex.try_lock().expect("nobody holds it");
    /// assert!(mutex.try_lock().unwrap_err().is_locked());
    /// # drop(guard);
    /// ```
    pub fn try_lock(&self) -> Result<MutexGuard<'_, T>, TryLockError<'_, T>> {
        let hold = self.core().try_take(1).ok_or(TryLockError::Locked)?;
        self.held(hold).map_err(TryLockError::OwnerDied)
    }

    /// Like [`lock`](Self::lock), for at most `timeout` from its first poll on. Exact: it times out
    /// only if it has not locked. One that need not wait does not read the clock.
    ///
    /// # Panics
    ///
    /// When it has to wait on a thread that runs no process of LUNA: there it has no timers.
    ///
    /// ```
    /// # use luna_channels::lock_sync::Mutex;
    /// # luna_core::block_on(async {
    /// let mutex = Mutex::new(());
    /// let guard = mutex.lock().await.unwrap();
    /// let late = mutex.lock_timeout(std::time::Duration::from_millis(1)).await;
    /// assert!(late.unwrap_err().is_timeout());
    /// # drop(guard);
    /// # }).unwrap();
    /// ```
    pub fn lock_timeout(&self, timeout: Duration) -> LockTimeout<'_, T> {
        self.lock().until(Sleep::after(timeout))
    }

    /// Like [`lock_timeout`](Self::lock_timeout), until an absolute deadline.
    pub fn lock_deadline(&self, deadline: Instant) -> LockTimeout<'_, T> {
        self.lock().until(Sleep::until(deadline))
    }

    /// Like [`lock`](Self::lock), blocking this thread. For plain threads and OS-thread processes.
    /// A plain thread waits at its own OS priority, which takes two system calls to learn; its
    /// first call allocates what is known of the thread.
    ///
    /// # Errors
    ///
    /// As for `lock`.
    ///
    /// # Panics
    ///
    /// In a process of an executor, which it would stop.
    #[cfg(not(loom))]
    #[track_caller]
    pub fn blocking_lock(&self) -> Result<MutexGuard<'_, T>, LockError<'_, T>> {
        self.taken(1, luna_core::park::block_on(self.take(true)))
    }

    /// Like [`blocking_lock`](Self::blocking_lock), for at most `timeout`.
    ///
    /// # Errors
    ///
    /// [`LockTimeoutError`].
    ///
    /// # Panics
    ///
    /// As for `blocking_lock`.
    ///
    /// ```
    /// # use luna_channels::lock_sync::Mutex;
    /// let mutex = Mutex::new(());
    /// let guard = mutex.blocking_lock().unwrap();
    /// let late = mutex.blocking_lock_timeout(std::time::Duration::from_millis(1));
    /// assert!(late.unwrap_err().is_timeout());
    /// # drop(guard);
    /// ```
    #[cfg(not(loom))]
    #[track_caller]
    pub fn blocking_lock_timeout(
        &self,
        timeout: Duration,
    ) -> Result<MutexGuard<'_, T>, LockTimeoutError<'_, T>> {
        self.taken_in_time(1, replay::block_for(self.take(true), timeout))
    }

    /// The result for the holder.
    #[inline]
    pub(super) fn held<'a>(
        &'a self,
        hold: Hold<'_>,
    ) -> Result<MutexGuard<'a, T>, OwnerDied<'a, T>> {
        let guard = MutexGuard::new(self, hold);
        match self.value.has_died.load(Ordering::Relaxed) {
            true => Err(OwnerDied::new(guard)),
            false => Ok(guard),
        }
    }

    /// Names the mutex in reports: see [`inspect`](crate::inspect). Not for the real-time path.
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        self.core().identity.set_name(name);
        self
    }
}

impl<T> Clone for Mutex<T> {
    fn clone(&self) -> Self {
        self.value.handles.fetch_add(1, Ordering::Relaxed);
        Mutex {
            core: self.core.clone(),
            value: self.value.clone(),
        }
    }
}

impl<T> Drop for Mutex<T> {
    fn drop(&mut self) {
        if self.value.handles.fetch_sub(1, Ordering::AcqRel) == 1 {
            let value = &self.value.value;
            // SAFETY: this was the last handle, so the mutex is free, and can never be locked
            // again: the value is dropped once.
            value.with_mut(|value| unsafe { ManuallyDrop::drop(&mut *value) });
        }
    }
}

impl<T: Send + Default> Default for Mutex<T> {
    #[track_caller]
    fn default() -> Self {
        Self::new(T::default())
    }
}

luna_platform::debug_fields!(impl[T] Mutex<T>, |mutex| shared: &raw const *mutex.core);
