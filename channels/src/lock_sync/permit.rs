//! Permits that were taken.

use super::semaphore::Semaphore;
use core::mem::ManuallyDrop;

/// Permits of a [`Semaphore`], which are given back when this is dropped: O(waiters served by
/// them), for the real-time path.
///
/// They may be kept across awaits, and be sent to another process or thread.
///
/// ```
/// use luna_channels::lock_sync::Semaphore;
///
/// let semaphore = Semaphore::new(2);
/// semaphore.try_acquire().unwrap().forget(); // for good
/// assert_eq!(semaphore.available_permits(), 1);
/// ```
#[derive(Debug)]
#[must_use = "the permits are given back when this is dropped"]
pub struct SemaphorePermit<'a> {
    semaphore: &'a Semaphore,
    count: u32,
}

impl<'a> SemaphorePermit<'a> {
    /// So many that the caller has taken, and gives away.
    pub(super) fn taken(semaphore: &'a Semaphore, count: u32) -> Self {
        Self { semaphore, count }
    }

    /// How many they are.
    pub fn num_permits(&self) -> u32 {
        self.count
    }

    /// Does not give them back: the semaphore has so many less from now on.
    pub fn forget(self) {
        let _ = ManuallyDrop::new(self);
    }
}

impl Drop for SemaphorePermit<'_> {
    fn drop(&mut self) {
        self.semaphore.core().give_back(self.count);
    }
}
