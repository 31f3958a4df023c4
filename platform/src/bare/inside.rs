//! Whether the owner of a bias is inside a lock: then no interrupt comes.
//!
//! So a context that revokes a bias never finds the owner inside, and never waits for it. What the
//! bias saves is the way through the shared lock.

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
