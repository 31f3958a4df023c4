//! The backend on the standard library alone: what every system but Linux gets.

pub mod boost;
pub(crate) mod reactor;
pub(crate) mod thread;

pub(crate) mod clock {
    use std::sync::OnceLock;
    use std::time::{Duration, Instant};

    /// Nanoseconds since the first call, from `std::time::Instant`.
    #[inline]
    pub(crate) fn monotonic_nanos() -> u64 {
        static ORIGIN: OnceLock<Instant> = OnceLock::new();
        // The origin lies a second back, so that 0 stays free for "before everything".
        let elapsed = ORIGIN.get_or_init(Instant::now).elapsed().as_nanos();
        u64::try_from(elapsed)
            .unwrap_or(u64::MAX)
            .saturating_add(1_000_000_000)
    }

    /// The standard library does not report it.
    pub(crate) fn processor_time() -> Option<Duration> {
        None
    }
}

pub mod fence {
    //! There is no asymmetric pair of fences here, so no lock is biased.

    /// Asks for the heavy fence, once for the program.
    pub fn prepare() {}

    /// Whether the heavy fence can be had.
    pub fn is_available() -> bool {
        false
    }

    /// Orders what this thread does for a thread that calls [`heavy`].
    pub fn light() {}

    /// A full fence on this thread and on each other one of the program.
    pub fn heavy() {
        unreachable!("no lock is biased without it");
    }
}

pub(crate) mod futex {
    //! A word to wait on, as a mutex and a condition variable beside an atomic.

    use crate::clock::Instant;
    use crate::futex::Waited;
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::sync::{Condvar, Mutex, PoisonError};
    use std::time::Duration;

    /// A 32-bit word that threads can wait on.
    ///
    /// Change the word first, through [`word`](Self::word), then wake: a thread that is about to
    /// wait sees the change or the wake.
    #[derive(Debug)]
    pub struct Futex {
        word: AtomicU32,
        lock: Mutex<()>,
        changed: Condvar,
    }

    impl Futex {
        /// A word that holds `value`.
        pub const fn new(value: u32) -> Self {
            Self {
                word: AtomicU32::new(value),
                lock: Mutex::new(()),
                changed: Condvar::new(),
            }
        }

        /// The word itself.
        #[inline]
        pub fn word(&self) -> &AtomicU32 {
            &self.word
        }

        /// Waits while the word holds `expected`, at most until `deadline` ([`Instant::NEVER`]:
        /// without end).
        pub fn wait(&self, expected: u32, deadline: Instant) -> Waited {
            let guard = self.lock.lock().unwrap_or_else(PoisonError::into_inner);
            if self.word.load(Ordering::SeqCst) != expected {
                return Waited::Woken;
            }
            if deadline == Instant::NEVER {
                drop(
                    self.changed
                        .wait(guard)
                        .unwrap_or_else(PoisonError::into_inner),
                );
                return Waited::Woken;
            }
            let left: Duration = deadline - Instant::now_real();
            if left.is_zero() {
                return Waited::TimedOut;
            }
            let (guard, outcome) = self
                .changed
                .wait_timeout(guard, left)
                .unwrap_or_else(PoisonError::into_inner);
            drop(guard);
            // The clock of the caller decides, not the condition variable's.
            if outcome.timed_out() && Instant::now_real() >= deadline {
                Waited::TimedOut
            } else {
                Waited::Woken
            }
        }

        /// Wakes one waiting thread.
        pub fn wake_one(&self) {
            // Taking the lock orders this wake after the check of a thread that is about to wait.
            drop(self.lock.lock().unwrap_or_else(PoisonError::into_inner));
            self.changed.notify_one();
        }

        /// Wakes all waiting threads.
        pub fn wake_all(&self) {
            drop(self.lock.lock().unwrap_or_else(PoisonError::into_inner));
            self.changed.notify_all();
        }
    }
}

pub mod inside {
    //! No lock is biased here, so no thread is ever inside.

    /// The word of a biased lock that says whether its owner is inside.
    #[derive(Debug)]
    pub struct Inside;

    impl Inside {
        /// Not entered.
        pub const fn new() -> Self {
            Self
        }

        /// Whether a thread is inside.
        pub fn is_entered(&self) -> bool {
            false
        }

        /// The owner enters.
        ///
        /// # Safety
        ///
        /// As on Linux.
        pub unsafe fn enter_unchecked(&self, _: u32) {}

        /// What the calling thread writes when it enters.
        pub fn id_of_this_thread() -> u32 {
            0
        }

        /// Panics if this thread is inside.
        pub fn assert_not_here(&self) {}

        /// The owner leaves.
        pub fn leave(&self) {}

        /// The owner has left, and the bias was revoked meanwhile.
        pub fn leave_revoked(&self) {}

        /// Waits until the owner is outside. The caller has revoked the bias.
        pub fn wait_until_left(&self) {}
    }
}

pub mod lock {
    //! A lock with the interface of the priority-inheriting one; it inherits nothing, since the
    //! standard library offers no such lock.

    use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

    /// A mutual exclusion lock around a value.
    ///
    /// On this backend it is `std::sync::Mutex` without poisoning: there are no real-time policies
    /// here, so nothing to inherit.
    #[derive(Debug)]
    pub struct PiLock<T>(Mutex<T>);

    /// Unlocks when dropped.
    pub type PiGuard<'a, T> = MutexGuard<'a, T>;

    impl<T> PiLock<T> {
        /// An unlocked lock around `value`.
        pub const fn new(value: T) -> Self {
            Self(Mutex::new(value))
        }

        /// Locks, waiting as long as another thread holds it.
        #[inline]
        pub fn lock(&self) -> PiGuard<'_, T> {
            self.0.lock().unwrap_or_else(PoisonError::into_inner)
        }

        /// Locks if the lock is free.
        pub fn try_lock(&self) -> Option<PiGuard<'_, T>> {
            match self.0.try_lock() {
                Ok(guard) => Some(guard),
                Err(TryLockError::Poisoned(error)) => Some(error.into_inner()),
                Err(TryLockError::WouldBlock) => None,
            }
        }

        /// The value, without locking: the exclusive borrow shows that no guard exists.
        pub fn get_mut(&mut self) -> &mut T {
            self.0.get_mut().unwrap_or_else(PoisonError::into_inner)
        }
    }
}
