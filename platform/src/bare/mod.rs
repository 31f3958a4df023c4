//! The backend without an operating system: one CPU, and its interrupts.
//!
//! It is picked by the absence of the feature `std`. A program gives it a [`Port`]: a clock, and a
//! way to idle and to end that. The critical section comes from the crate `critical-section`, which
//! has implementations for most chips. docs/no-std.md shows a whole port.
//!
//! # Contexts
//!
//! What is a thread elsewhere is a *context* here: the program is one, and each [`interrupt`] that
//! is running is another. A context has thread-locals of its own ([`Local`]), so code in an
//! interrupt looks to channels and executors like another thread. It runs no executor, and its
//! wakes take the way of a remote thread's: a few bits, and the port's [`wake`](Port::wake) if the
//! executor idles.
//!
//! # Locks
//!
//! A lock ([`lock`]) is the critical section: an interrupt cannot wait for what it has interrupted.
//! Locks are biased as elsewhere, since the fast paths rely on it; but the owner of a bias enters
//! by beginning the critical section ([`inside`]). So an interrupt that revokes a bias finds the
//! owner outside, and waits for nothing. docs/no-std.md lists what runs with interrupts disabled.
//!
//! # Allocation and panics
//!
//! Nothing here allocates. Panics end the program: nothing is caught.

#[cfg(any(not(target_has_atomic = "64"), debug_assertions))]
mod atomic;
mod context;
mod critical;
mod port;

#[path = "../portable/boost.rs"]
pub mod boost;
pub(crate) mod futex;
pub mod lock;

#[cfg(any(not(target_has_atomic = "64"), debug_assertions))]
pub use atomic::{AtomicI64, AtomicU64};
#[doc(hidden)]
pub use context::CONTEXTS;
pub use context::{AccessError, Local, NESTED_INTERRUPTS, interrupt, is_interrupt};
pub use once::OnceLock;
pub use port::{Port, install};

pub mod alarm {
    //! A port has no other thread that could ring.

    use crate::clock::Instant;

    /// The alarm of a thread. There is none: [`new`](Self::new) gives nothing.
    #[derive(Debug)]
    pub enum Alarm {}

    impl Alarm {
        /// Gives nothing.
        pub fn new(_ring: impl Fn() + Send + Sync + 'static) -> Option<Alarm> {
            None
        }

        /// There is none to be armed.
        pub fn arm(&self, _deadline: Instant) {
            match *self {}
        }

        /// There is none to be disarmed.
        pub fn disarm(&self) {
            match *self {}
        }

        /// There is none to be asked.
        pub fn take_rung(&self) -> Option<Instant> {
            match *self {}
        }
    }
}

pub(crate) mod clock {
    //! The port's clock.

    use super::port::port;

    /// Nanoseconds on the port's clock.
    #[inline]
    pub(crate) fn monotonic_nanos() -> u64 {
        port().now()
    }
}

pub mod fence {
    //! The fences of biased locks: the contexts of one CPU see its stores in their order, so only
    //! the compiler is kept from changing it.

    use core::sync::atomic::{Ordering, compiler_fence};

    /// Asks for the heavy fence, once for the program.
    pub fn prepare() {}

    /// Whether the heavy fence can be had.
    #[inline(always)]
    pub fn is_available() -> bool {
        true
    }

    /// Orders what this context does for one that calls [`heavy`].
    #[inline(always)]
    pub fn light() {
        compiler_fence(Ordering::SeqCst);
    }

    /// A full fence for all contexts.
    #[inline]
    pub fn heavy() {
        compiler_fence(Ordering::SeqCst);
    }
}

pub mod inside {
    //! Whether the owner of a bias is inside a lock: then no interrupt comes.
    //!
    //! So a context that revokes a bias never finds the owner inside, and never waits for it. What
    //! the bias saves is the way through the shared lock.

    use super::critical;
    use core::sync::atomic::{AtomicBool, Ordering};

    /// The word of a biased lock that says whether its owner is inside.
    #[derive(Debug)]
    pub struct Inside(AtomicBool);

    impl Inside {
        /// Not entered.
        pub const fn new() -> Self {
            Self(AtomicBool::new(false))
        }

        /// Whether the owner is inside; asked by its own context, or in a critical section.
        #[inline(always)]
        pub fn is_entered(&self) -> bool {
            self.0.load(Ordering::Relaxed)
        }

        /// The owner enters.
        ///
        /// # Safety
        ///
        /// The calling context is not inside.
        #[inline(always)]
        pub unsafe fn enter_unchecked(&self, _: u32) {
            critical::enter();
            self.0.store(true, Ordering::Relaxed);
        }

        /// What the calling context writes when it enters: nothing that differs.
        pub fn id_of_this_thread() -> u32 {
            0
        }

        /// Panics if this context is inside: no other one runs while the owner is.
        #[inline]
        pub fn assert_not_here(&self) {
            assert!(!self.is_entered(), "this context holds the lock already");
        }

        /// The owner leaves.
        #[inline(always)]
        pub fn leave(&self) {
            self.0.store(false, Ordering::Relaxed);
            // SAFETY: the owner has entered, and leaves once: that is how the lock uses this.
            unsafe { critical::leave() };
        }

        /// The owner has left, and the bias was revoked meanwhile: nothing waits for it.
        #[inline]
        pub fn leave_revoked(&self) {}

        /// The owner is outside, since the calling context runs.
        #[inline]
        pub fn wait_until_left(&self) {
            self.assert_not_here();
        }
    }
}

mod once {
    //! A value that is set once, with the names of `std::sync::OnceLock`.

    use core::cell::UnsafeCell;
    use core::fmt;
    use core::sync::atomic::{AtomicBool, Ordering};

    /// A value that is set once, from any context.
    pub struct OnceLock<T> {
        is_set: AtomicBool,
        value: UnsafeCell<Option<T>>,
    }

    // SAFETY: the value is written once, in a critical section, before it is marked as set, and
    // then only read. One context may set it, and another drop it.
    unsafe impl<T: Send + Sync> Sync for OnceLock<T> {}

    impl<T> OnceLock<T> {
        /// Nothing is set.
        pub const fn new() -> Self {
            Self {
                is_set: AtomicBool::new(false),
                value: UnsafeCell::new(None),
            }
        }

        /// The value, if it is set.
        #[inline]
        pub fn get(&self) -> Option<&T> {
            if !self.is_set.load(Ordering::Acquire) {
                return None;
            }
            // SAFETY: it was written before it was marked as set, and is not written again.
            unsafe { &*self.value.get() }.as_ref()
        }

        /// Sets it.
        ///
        /// # Errors
        ///
        /// The value, if one is set already.
        pub fn set(&self, value: T) -> Result<(), T> {
            critical_section::with(|_| {
                if self.is_set.load(Ordering::Relaxed) {
                    return Err(value);
                }
                // SAFETY: nothing reads it before it is marked as set, and nothing else writes it:
                // this is a critical section.
                unsafe { *self.value.get() = Some(value) };
                self.is_set.store(true, Ordering::Release);
                Ok(())
            })
        }
    }

    impl<T: fmt::Debug> fmt::Debug for OnceLock<T> {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.debug_tuple("OnceLock").field(&self.get()).finish()
        }
    }
}
