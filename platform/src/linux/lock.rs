//! The priority-inheriting lock.
//!
//! The word holds the owner's thread id, 0 when free, and the kernel's `FUTEX_WAITERS` bit when a
//! thread waits in the kernel: the protocol of `FUTEX_LOCK_PI(2const)`. Free and uncontended,
//! locking and unlocking are one compare-and-swap each. Contended, the waiter first watches the
//! word for a bounded while (an owner on another core leaves within some tens of nanoseconds), then
//! asks the kernel, which boosts the owner to the waiter's priority and hands the lock over in
//! order of priority. A thread that may spin before it sleeps spins for longer, and looks less
//! often (`spin::at_lock`).

use crate::path::{self, Call};
use crate::spin;
use nix::errno::Errno;
use std::cell::{Cell, UnsafeCell};
use std::fmt;
use std::hint::spin_loop;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// The number of looks at a contended lock before the kernel is asked: about half a microsecond. It
/// is bounded, so an owner that was preempted on this very core costs that much and no more. A
/// thread that spins for longer shares its core with no other process of its system.
const LOOKS_BEFORE_KERNEL: u32 = 40;

/// A priority-inheriting mutual exclusion lock around a value.
///
/// The owner inherits the priority of a waiting thread, so that a thread of middle priority cannot
/// delay it (`FUTEX_LOCK_PI2`, or `FUTEX_LOCK_PI` on kernels before 5.14). Hold it for a bounded
/// number of steps. Not poisoned by a panic. Real-time path: yes; O(1) free, otherwise the owner's
/// section and those of waiters of higher priority.
///
/// # Panics
///
/// `lock` panics if the calling thread holds the lock already, or if a thread has ended as its
/// owner.
///
/// ```
/// use luna_platform::lock::PiLock;
///
/// let count = PiLock::new(0);
/// *count.lock() += 1;
/// assert_eq!(*count.lock(), 1);
/// ```
///
/// # Invariants
///
/// `value` is accessed only by the thread whose id is in `word`, through the one guard that its
/// `lock` returned.
#[repr(C)]
pub struct PiLock<T> {
    /// Beside the beginning of the value: a thread that takes the lock from another core fetches
    /// both.
    word: AtomicU32,
    value: UnsafeCell<T>,
}

// SAFETY: the lock gives access to one thread at a time, so it may be shared if the value may move
// between threads.
unsafe impl<T: Send> Sync for PiLock<T> {}
// SAFETY: a lock that is moved is not borrowed, so no guard exists; it is as `Send` as its value.
unsafe impl<T: Send> Send for PiLock<T> {}

/// Unlocks when dropped. Not `Send`, since the kernel knows the owner by its thread.
pub struct PiGuard<'a, T> {
    lock: &'a PiLock<T>,
    stays_on_its_thread: PhantomData<*const ()>,
}

// SAFETY: a shared guard gives `&T` alone.
unsafe impl<T: Sync> Sync for PiGuard<'_, T> {}

impl<T> PiLock<T> {
    /// An unlocked lock around `value`.
    pub const fn new(value: T) -> Self {
        Self {
            word: AtomicU32::new(0),
            value: UnsafeCell::new(value),
        }
    }

    /// Locks. Waits while another thread holds it.
    #[inline]
    pub fn lock(&self) -> PiGuard<'_, T> {
        let me = thread_id();
        if self
            .word
            .compare_exchange(0, me, Ordering::Acquire, Ordering::Relaxed)
            .is_err()
        {
            self.lock_contended(me);
        }
        self.guard()
    }

    /// Locks if the lock is free.
    #[inline]
    pub fn try_lock(&self) -> Option<PiGuard<'_, T>> {
        self.word
            .compare_exchange(0, thread_id(), Ordering::Acquire, Ordering::Relaxed)
            .is_ok()
            .then(|| self.guard())
    }

    /// The value, without locking: the exclusive borrow shows that no guard exists.
    pub fn get_mut(&mut self) -> &mut T {
        self.value.get_mut()
    }

    #[inline]
    fn guard(&self) -> PiGuard<'_, T> {
        PiGuard {
            lock: self,
            stays_on_its_thread: PhantomData,
        }
    }

    #[cold]
    fn lock_contended(&self, me: u32) {
        let (looks, pauses) = spin::at_lock().unwrap_or((LOOKS_BEFORE_KERNEL, 1));
        // The first look comes after half the pause: a short holder is done by then.
        let mut wait = pauses.div_ceil(2);
        for _ in 0..looks {
            let word = self.word.load(Ordering::Relaxed);
            if word == 0
                && self
                    .word
                    .compare_exchange(0, me, Ordering::Acquire, Ordering::Relaxed)
                    .is_ok()
            {
                return;
            }
            // Threads wait in the kernel already: the lock will be handed to them, so spinning is
            // of no use.
            if word & libc::FUTEX_WAITERS != 0 {
                break;
            }
            (0..wait).for_each(|_| spin_loop());
            wait = pauses;
        }
        lock_pi(&self.word);
    }
}

/// Takes `word` in the kernel, which boosts its owner to this thread's priority until then.
pub(super) fn lock_pi(word: &AtomicU32) {
    loop {
        match path::expected(Call::Lock, || futex_pi(word, lock_operation())) {
            Ok(()) => {
                // The kernel wrote the word, which is no synchronization to the language: this
                // reads what the former owner released. ThreadSanitizer relies on it too.
                let _ = word.load(Ordering::Acquire);
                return;
            }
            // A signal came, or the owner is just ending: ask again.
            Err(Errno::EINTR | Errno::EAGAIN) => {}
            Err(Errno::ENOSYS) if lock_operation() == libc::FUTEX_LOCK_PI2 => {
                HAS_LOCK_PI2.store(false, Ordering::Relaxed);
            }
            Err(Errno::EDEADLK) => {
                panic!("a thread locked a priority-inheriting lock that it holds already")
            }
            Err(Errno::ESRCH) => {
                panic!("a thread ended while it held a priority-inheriting lock")
            }
            Err(error) => panic!("the kernel refused a priority-inheriting lock: {error}"),
        }
    }
}

/// `FUTEX_LOCK_PI2` came with Linux 5.14; set to false once on a kernel without it.
static HAS_LOCK_PI2: AtomicBool = AtomicBool::new(true);

fn lock_operation() -> i32 {
    if HAS_LOCK_PI2.load(Ordering::Relaxed) {
        libc::FUTEX_LOCK_PI2
    } else {
        libc::FUTEX_LOCK_PI
    }
}

pub(super) fn futex_pi(word: &AtomicU32, operation: i32) -> Result<(), Errno> {
    // SAFETY: the word outlives the call; the two operations used take no other pointer but a null
    // deadline.
    let outcome = unsafe {
        libc::syscall(
            libc::SYS_futex,
            word.as_ptr(),
            operation | libc::FUTEX_PRIVATE_FLAG,
            0,
            std::ptr::null::<libc::timespec>(),
        )
    };
    Errno::result(outcome).map(drop)
}

thread_local! {
    static THREAD_ID: Cell<u32> = const { Cell::new(0) };
}

/// The kernel's id of this thread, read once. A process that was forked without exec must not use
/// locks of its parent.
#[inline]
pub(super) fn thread_id() -> u32 {
    THREAD_ID.with(|id| {
        if id.get() == 0 {
            id.set(nix::unistd::gettid().as_raw() as u32);
        }
        id.get()
    })
}

impl<T> Drop for PiGuard<'_, T> {
    #[inline]
    fn drop(&mut self) {
        unlock_pi(&self.lock.word);
    }
}

/// Releases `word`, which this thread owns.
#[inline]
pub(super) fn unlock_pi(word: &AtomicU32) {
    if word
        .compare_exchange(thread_id(), 0, Ordering::Release, Ordering::Relaxed)
        .is_err()
    {
        unlock_contended(word);
    }
}

#[cold]
fn unlock_contended(word: &AtomicU32) {
    // The kernel's store is no release to the language: this one is, and changes nothing else.
    word.fetch_or(0, Ordering::Release);
    // The kernel hands the lock to the waiter of highest priority; it cannot refuse the owner.
    let outcome = path::expected(Call::Lock, || futex_pi(word, libc::FUTEX_UNLOCK_PI));
    debug_assert!(outcome.is_ok(), "unlocking failed: {outcome:?}");
}

impl<T> Deref for PiGuard<'_, T> {
    type Target = T;
    #[inline]
    fn deref(&self) -> &T {
        // SAFETY: this guard exists, so this thread owns the lock.
        unsafe { &*self.lock.value.get() }
    }
}

impl<T> DerefMut for PiGuard<'_, T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: this guard exists, so this thread owns the lock, and the guard is borrowed
        // exclusively.
        unsafe { &mut *self.lock.value.get() }
    }
}

impl<T: fmt::Debug> fmt::Debug for PiLock<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.try_lock() {
            Some(guard) => f.debug_tuple("PiLock").field(&*guard).finish(),
            // Debug output never waits.
            None => f.write_str("PiLock(<locked>)"),
        }
    }
}

impl<T: fmt::Debug> fmt::Debug for PiGuard<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Instant;
    use crate::spin::Outside;
    use std::sync::Arc;
    use std::time::Duration;

    /// Longer than any of this takes on a loaded machine: a hang, then.
    const WATCHDOG: Duration = Duration::from_secs(60);

    /// A thread with its core to itself.
    struct Patient;

    impl Outside for Patient {
        fn is_called(&self) -> bool {
            false
        }

        fn time(&self) -> Duration {
            spin::LONGEST
        }
    }

    /// The holder does not leave before that, so the bound alone ends the spinning.
    #[test]
    fn one_that_looks_for_longer_asks_the_kernel_in_the_end() {
        let lock = Arc::new(PiLock::new(0));
        let held = lock.lock();
        let waiter = std::thread::spawn({
            let lock = lock.clone();
            move || {
                let _looking = spin::enter(Arc::new(Patient));
                assert!(spin::at_lock().is_some());
                *lock.lock() += 1;
            }
        });
        let end = Instant::now() + WATCHDOG;
        while lock.word.load(Ordering::Relaxed) & libc::FUTEX_WAITERS == 0 {
            assert!(Instant::now() < end, "it looks without a bound");
            std::thread::yield_now();
        }
        drop(held);
        waiter.join().unwrap();
        assert_eq!(*lock.lock(), 1);
    }

    #[test]
    fn those_that_look_for_longer_are_excluded_too() {
        const ROUNDS: u32 = 20_000;
        // Two numbers that differ only while a thread is inside.
        let lock = Arc::new(PiLock::new((0, 0)));
        let threads = [true, true, false].map(|is_patient| {
            let lock = lock.clone();
            std::thread::spawn(move || {
                let _looking = is_patient.then(|| spin::enter(Arc::new(Patient)));
                for _ in 0..ROUNDS {
                    let mut pair = lock.lock();
                    assert_eq!(pair.0, pair.1);
                    pair.0 += 1;
                    std::hint::spin_loop();
                    pair.1 += 1;
                }
            })
        });
        for thread in threads {
            thread.join().unwrap();
        }
        assert_eq!(*lock.lock(), (3 * ROUNDS, 3 * ROUNDS));
    }
}
