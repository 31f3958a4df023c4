//! A word to wait on and a lock, made of a mutex and a condition variable: the standard library's,
//! or in a model the checker's. `threads`, in the parent module, is the one or the other.

pub(crate) mod futex {
    //! A word to wait on, as a mutex and a condition variable beside an atomic.

    use super::super::threads::atomic::{AtomicU32, Ordering};
    use super::super::threads::{Condvar, Mutex};
    use crate::clock::Instant;
    use crate::futex::Waited;
    use std::sync::PoisonError;

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
        #[cfg(not(loom))]
        pub const fn new(value: u32) -> Self {
            Self {
                word: AtomicU32::new(value),
                lock: Mutex::new(()),
                changed: Condvar::new(),
            }
        }

        /// A word that holds `value`.
        #[cfg(loom)]
        pub fn new(value: u32) -> Self {
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
            let left = deadline - Instant::now_real();
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

pub mod lock {
    //! A lock with the interface of the priority-inheriting one; it inherits nothing, since the
    //! standard library offers no such lock.

    use super::super::threads::{Mutex, MutexGuard};
    use std::sync::{PoisonError, TryLockError};

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
        #[cfg(not(loom))]
        pub const fn new(value: T) -> Self {
            Self(Mutex::new(value))
        }

        /// An unlocked lock around `value`.
        #[cfg(loom)]
        pub fn new(value: T) -> Self {
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
