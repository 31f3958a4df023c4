//! References to one thing that all processes of a thread have, passed on from those that have ended to those that begin.
//!
//! A process refers to what it shares with the others of its thread: its executor, say. Counting each of these references is two atomic
//! read-modify-write operations a process; one that is handed on is counted already.

use std::cell::Cell;
use std::fmt;
use std::mem;
use std::ptr;
use std::sync::Arc;

/// How many are kept at most: more would only be counted that nobody has.
const MOST: usize = 256;

/// References that nobody uses just now, all to the same thing: for a thread-local variable.
///
/// ```
/// use luna_core::arc_cache::ArcCache;
/// use std::sync::Arc;
///
/// let spare = ArcCache::new();
/// let thing = Arc::new(7);
/// spare.keep(&thing);
/// let one = spare.another(&thing);
/// spare.give_back(one);
/// assert_eq!(Arc::strong_count(&thing), 2, "it is kept for the next");
/// let next = spare.another(&thing);
/// assert_eq!((*next, Arc::strong_count(&thing)), (7, 2), "who was not counted anew");
/// spare.release();
/// assert_eq!(Arc::strong_count(&thing), 2, "it is the next one's own");
/// ```
///
/// # Invariants
///
/// As many references to `of` as `count` says belong to this.
pub struct ArcCache<T> {
    of: Cell<*const T>,
    count: Cell<usize>,
}

impl<T> ArcCache<T> {
    /// One that keeps none.
    pub const fn new() -> Self {
        Self {
            of: Cell::new(ptr::null()),
            count: Cell::new(0),
        }
    }

    /// Whether references to `of` are kept.
    #[inline]
    pub fn keeps(&self, of: &Arc<T>) -> bool {
        ptr::eq(self.of.get(), Arc::as_ptr(of))
    }

    /// From now on references to `of` are kept, and those that were are released.
    pub fn keep(&self, of: &Arc<T>) {
        self.release();
        self.of.set(Arc::as_ptr(of));
    }

    /// A reference to `of`: one that was given back, if it can be. O(1); nothing is allocated or freed.
    #[inline]
    pub fn another(&self, of: &Arc<T>) -> Arc<T> {
        let count = self.count.get();
        if count == 0 || !self.keeps(of) {
            return of.clone();
        }
        self.count.set(count - 1);
        // SAFETY: the invariant: this has one more, which it gives away.
        unsafe { Arc::from_raw(self.of.get()) }
    }

    /// Takes a reference that is no longer needed, if it is one that is kept, and drops it otherwise. O(1).
    #[inline]
    pub fn give_back(&self, one: Arc<T>) {
        if self.keeps(&one) && self.count.get() < MOST {
            mem::forget(one);
            self.count.set(self.count.get() + 1);
        }
    }

    /// Drops all that are kept, and keeps no more.
    pub fn release(&self) {
        let of = self.of.replace(ptr::null());
        for _ in 0..self.count.take() {
            // SAFETY: the invariant; it is given away as often as it is counted.
            drop(unsafe { Arc::from_raw(of) });
        }
    }
}

impl<T> Default for ArcCache<T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T> Drop for ArcCache<T> {
    fn drop(&mut self) {
        self.release();
    }
}

impl<T> fmt::Debug for ArcCache<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ArcCache")
            .field("count", &self.count.get())
            .finish_non_exhaustive()
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
        for _ in 0..2 * MOST {
            spare.give_back(thing.clone());
        }
        assert_eq!(Arc::strong_count(&thing), 1 + MOST);
        assert!(Arc::ptr_eq(&spare.another(&other), &other));
        assert_eq!(Arc::strong_count(&thing), 1 + MOST);
        spare.keep(&other);
        assert_eq!(Arc::strong_count(&thing), 1);
    }

    #[test]
    fn what_is_kept_goes_with_it() {
        let thing = Arc::new(1);
        let spare = ArcCache::new();
        spare.keep(&thing);
        spare.give_back(thing.clone());
        let one = spare.another(&thing);
        spare.give_back(one);
        drop(spare);
        assert_eq!(Arc::strong_count(&thing), 1);
    }
}
