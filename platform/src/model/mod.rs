//! loom's clock, lock and wait: what the protocols are checked on. There are no threads' attributes
//! and no files here.

#[path = "../portable/boost.rs"]
pub mod boost;
#[path = "../portable/sync.rs"]
#[allow(dead_code, reason = "the models use a part")]
mod sync;

use loom::sync as threads;
pub(crate) use sync::futex;
pub use sync::lock;

pub(crate) mod clock {
    /// Time stands still in a model: deadlines never come.
    pub(crate) fn monotonic_nanos() -> u64 {
        0
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

pub mod spin {
    //! Spinning, where the clock stands still: a few looks, since the continuation does not depend
    //! on their number.

    use crate::clock::Instant;
    use core::cell::Cell;
    use core::time::Duration;

    loom::thread_local! {
        static IS_ALLOWED: Cell<bool> = Cell::new(false);
    }

    /// The thread declares that its operations spin.
    pub fn let_look() {
        IS_ALLOWED.with(|looks| looks.set(true));
    }

    /// Whether the thread called [`let_look`].
    pub fn is_allowed() -> bool {
        IS_ALLOWED.with(Cell::get)
    }

    /// Looks once.
    pub fn look(mut is_over: impl FnMut() -> bool) -> bool {
        is_over()
    }

    /// Looks twice.
    pub fn until(mut is_over: impl FnMut() -> bool, _: Duration, _: Instant) -> bool {
        is_over() || is_over()
    }
}
