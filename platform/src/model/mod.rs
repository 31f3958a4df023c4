//! loom's clock, lock and wait: what the protocols are checked on. There are no threads' attributes
//! and no files here.

#[path = "../portable/boost.rs"]
pub mod boost;

pub(crate) mod clock {
    /// Time stands still in a model: deadlines never come.
    pub(crate) fn monotonic_nanos() -> u64 {
        0
    }
}

pub(crate) mod futex {
    //! A word to wait on, as a loom mutex and condition variable around a loom atomic.

    use crate::clock::Instant;
    use crate::futex::Waited;
    use loom::sync::atomic::{AtomicU32, Ordering};
    use loom::sync::{Condvar, Mutex};

    /// A 32-bit word that threads can wait on.
    #[derive(Debug)]
    pub struct Futex {
        word: AtomicU32,
        lock: Mutex<()>,
        changed: Condvar,
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

pub mod fence {
    //! Full fences on both sides: what the kernel makes of the pair.

    use loom::sync::atomic::{Ordering, fence};

    /// Asks for the heavy fence, once for the program.
    pub fn prepare() {}

    /// Whether the heavy fence can be had.
    pub fn is_available() -> bool {
        true
    }

    /// Orders what this thread does for a thread that calls [`heavy`].
    pub fn light() {
        fence(Ordering::SeqCst);
    }

    /// A full fence on this thread and on each other one of the program.
    pub fn heavy() {
        fence(Ordering::SeqCst);
    }
}

pub mod inside {
    //! The word without the priority inheritance: a waiting thread sleeps until it is woken.

    use crate::clock::Instant;
    use crate::futex::Futex;
    use loom::sync::atomic::Ordering;

    /// The word of a biased lock that says whether its owner is inside.
    #[derive(Debug)]
    pub struct Inside(Futex);

    impl Inside {
        /// Not entered.
        pub fn new() -> Self {
            Self(Futex::new(0))
        }

        /// Whether a thread is inside.
        pub fn is_entered(&self) -> bool {
            self.0.word().load(Ordering::Relaxed) != 0
        }

        /// The owner enters.
        ///
        /// # Safety
        ///
        /// As on Linux.
        pub unsafe fn enter_unchecked(&self, _: u32) {
            assert!(!self.is_entered(), "entered twice");
            self.0.word().store(1, Ordering::Relaxed);
        }

        /// What the calling thread writes when it enters.
        pub fn id_of_this_thread() -> u32 {
            0
        }

        /// A model's threads do not lock twice.
        pub fn assert_not_here(&self) {}

        /// The owner leaves.
        pub fn leave(&self) {
            self.0.word().store(0, Ordering::Release);
        }

        /// The owner has left, and the bias was revoked meanwhile.
        pub fn leave_revoked(&self) {
            self.0.wake_all();
        }

        /// Waits until the owner is outside. The caller has revoked the bias. On Linux too, the
        /// owner's store alone ends no wait in the kernel.
        pub fn wait_until_left(&self) {
            while self.0.word().load(Ordering::Acquire) != 0 {
                self.0.wait(1, Instant::NEVER);
            }
        }
    }
}
