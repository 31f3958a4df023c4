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
