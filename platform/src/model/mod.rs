//! loom's clock, lock and wait: what the protocols are checked on. There are no threads' attributes and no files here.

pub(crate) mod boost {
    //! Threads have no priorities in a model.

    #[derive(Debug)]
    pub(crate) struct Scheduling;

    pub(crate) fn scheduling() -> Scheduling {
        Scheduling
    }

    pub(crate) fn scheduling_again(_: &Scheduling) -> Scheduling {
        Scheduling
    }

    impl Scheduling {
        pub(crate) fn rank(&self) -> u8 {
            0
        }
    }

    pub(crate) fn boost(_: &Scheduling, _: u8) -> Result<(), i32> {
        Ok(())
    }

    pub(crate) fn restore(_: &Scheduling) {}
}

pub(crate) mod clock {
    /// Time stands still in a model: deadlines never come.
    pub(crate) fn monotonic_nanos() -> u64 {
        0
    }
}

pub mod futex {
    //! A word to wait on, as a loom mutex and condition variable around a loom atomic.

    use crate::clock::Instant;
    use loom::sync::atomic::{AtomicU32, Ordering};
    use loom::sync::{Condvar, Mutex};

    /// A 32-bit word that threads can wait on.
    #[derive(Debug)]
    pub struct Futex {
        word: AtomicU32,
        lock: Mutex<()>,
        changed: Condvar,
    }

    /// How a wait ended.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum Waited {
        /// Woken, or the word had changed, or for no reason: look again.
        Woken,
        /// The deadline came.
        TimedOut,
    }

    impl Futex {
        /// A word that holds `value`.
        pub fn new(value: u32) -> Self {
            Self {
                word: AtomicU32::new(value),
                lock: Mutex::new(()),
                changed: Condvar::new(),
            }
        }

        /// The word itself.
        pub fn word(&self) -> &AtomicU32 {
            &self.word
        }

        /// Waits while the word holds `expected`.
        pub fn wait(&self, expected: u32, _deadline: Instant) -> Waited {
            let guard = self.lock.lock().unwrap();
            if self.word.load(Ordering::SeqCst) == expected {
                drop(self.changed.wait(guard).unwrap());
            }
            Waited::Woken
        }

        /// Wakes one waiting thread.
        pub fn wake_one(&self) {
            drop(self.lock.lock().unwrap());
            self.changed.notify_one();
        }

        /// Wakes all waiting threads.
        pub fn wake_all(&self) {
            drop(self.lock.lock().unwrap());
            self.changed.notify_all();
        }
    }
}

pub mod lock {
    //! A plain mutex with the priority-inheriting lock's interface.

    use loom::sync::{Mutex, MutexGuard};

    /// Stands for the priority-inheriting lock.
    #[derive(Debug)]
    pub struct PiLock<T>(Mutex<T>);

    /// Unlocks when dropped.
    pub type PiGuard<'a, T> = MutexGuard<'a, T>;

    impl<T> PiLock<T> {
        /// An unlocked lock around `value`.
        pub fn new(value: T) -> Self {
            Self(Mutex::new(value))
        }

        /// Locks.
        pub fn lock(&self) -> PiGuard<'_, T> {
            self.0.lock().unwrap()
        }
    }
}

pub(crate) mod fence {
    //! Full fences on both sides: what the kernel makes of the pair.

    use loom::sync::atomic::{Ordering, fence};

    pub(crate) fn prepare() {}

    pub(crate) fn is_available() -> bool {
        true
    }

    pub(crate) fn light() {
        fence(Ordering::SeqCst);
    }

    pub(crate) fn heavy() {
        fence(Ordering::SeqCst);
    }
}

pub(crate) mod inside {
    //! The word without the kernel: who waits looks again and again.

    use loom::sync::atomic::{AtomicBool, Ordering};

    #[derive(Debug)]
    pub(crate) struct Inside(AtomicBool);

    impl Inside {
        pub(crate) fn new() -> Self {
            Self(AtomicBool::new(false))
        }

        pub(crate) fn is_entered(&self) -> bool {
            self.0.load(Ordering::Relaxed)
        }

        pub(crate) fn enter(&self) {
            assert!(!self.0.load(Ordering::Relaxed), "entered twice");
            self.0.store(true, Ordering::Relaxed);
        }

        /// A model's threads do not lock twice.
        pub(crate) fn assert_not_here(&self) {}

        pub(crate) fn leave(&self) {
            self.0.store(false, Ordering::Release);
        }

        pub(crate) fn leave_revoked(&self) {}

        pub(crate) fn wait_until_left(&self) {
            while self.0.load(Ordering::Acquire) {
                loom::thread::yield_now();
            }
        }
    }
}
