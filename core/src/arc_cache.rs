//! A cache of references to the timers of a thread, passed on from sleeps that have ended to new
//! ones.
//!
//! Counting each of these references costs two atomic read-modify-write operations a sleep; a
//! reference from the cache is counted already.

use alloc::sync::Arc;
use core::cell::Cell;
use core::mem;
use core::ptr;

/// Capacity of the cache.
const MAX: usize = 256;

/// Unused references, all to the same thing: for a thread-local variable.
///
/// # Invariants
///
/// The cache owns `count` references to `of`.
#[derive(Debug)]
pub(crate) struct ArcCache<T> {
    of: Cell<*const T>,
    count: Cell<usize>,
}

impl<T> ArcCache<T> {
    /// An empty cache.
    pub(crate) const fn new() -> Self {
        Self {
            of: Cell::new(ptr::null()),
            count: Cell::new(0),
        }
    }

    /// Whether references to `of` are kept.
    #[inline]
    pub(crate) fn keeps(&self, of: &Arc<T>) -> bool {
        ptr::eq(self.of.get(), Arc::as_ptr(of))
    }

    /// Keeps references to `of` from now on, and releases those that were kept.
    pub(crate) fn keep(&self, of: &Arc<T>) {
        self.release();
        self.of.set(Arc::as_ptr(of));
    }

    /// A returned reference, if there is one. O(1).
    #[inline]
    pub(crate) fn kept(&self) -> Option<Arc<T>> {
        let count = self.count.get();
        if count == 0 {
            return None;
        }
        self.count.set(count - 1);
        // SAFETY: by the invariant the cache owned one reference more, which it passes on here.
        Some(unsafe { Arc::from_raw(self.of.get()) })
    }

    /// Takes a reference that is no longer needed: keeps it if it is to `of`, and drops it
    /// otherwise. O(1).
    #[inline]
    pub(crate) fn give_back(&self, one: Arc<T>) {
        if self.keeps(&one) && self.count.get() < MAX {
            mem::forget(one);
            self.count.set(self.count.get() + 1);
        }
    }

    /// Drops all kept references, and keeps no more.
    pub(crate) fn release(&self) {
        let of = self.of.replace(ptr::null());
        for _ in 0..self.count.take() {
            // SAFETY: by the invariant the cache owns as many references as it counts, and each is
            // dropped once.
            drop(unsafe { Arc::from_raw(of) });
        }
    }
}

impl<T> Drop for ArcCache<T> {
    fn drop(&mut self) {
        self.release();
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn only_references_to_the_one_thing_are_kept_and_no_more_than_can_be_used() {
        let (thing, other) = (Arc::new(1), Arc::new(2));
        let spare = ArcCache::new();
        spare.give_back(thing.clone());
        assert_eq!(Arc::strong_count(&thing), 1, "nothing was to be kept");
        spare.keep(&thing);
        spare.give_back(other.clone());
        assert_eq!(Arc::strong_count(&other), 1);
        for _ in 0..2 * MAX {
            spare.give_back(thing.clone());
        }
        assert_eq!(Arc::strong_count(&thing), 1 + MAX);
        assert!(Arc::ptr_eq(&spare.kept().unwrap(), &thing));
        assert_eq!(Arc::strong_count(&thing), MAX);
        spare.keep(&other);
        assert_eq!(Arc::strong_count(&thing), 1);
    }

    #[test]
    fn what_is_kept_goes_with_it() {
        let thing = Arc::new(1);
        let spare = ArcCache::new();
        spare.keep(&thing);
        spare.give_back(thing.clone());
        let one = spare.kept().unwrap();
        spare.give_back(one);
        drop(spare);
        assert_eq!(Arc::strong_count(&thing), 1);
    }
}
