//! The backend on the standard library alone: what every system but Linux gets.

pub mod boost;
pub(crate) mod reactor;
mod sync;
pub(crate) mod thread;

use std::sync as threads;
pub(crate) use sync::futex;
pub use sync::lock;

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
