//! Shared ownership with a deferred end on the real-time path.

use super::{Retired, retire};
use alloc::boxed::Box;
use core::fmt;
use core::marker::PhantomData;
use core::mem::ManuallyDrop;
use core::ops::Deref;
use core::ptr::NonNull;
use luna_platform::sync::atomic::{AtomicUsize, Ordering};

/// A value with several owners, as [`Arc`](std::sync::Arc): but if the last owner is dropped on the
/// real-time path, the value is dropped and freed by the next call of [`collect`](super::collect),
/// on the thread that calls it.
///
/// `new` allocates. Cloning and dropping are for the real-time path: O(1), one atomic operation,
/// two for the last owner. There are no weak owners.
///
/// ```
/// use luna_core::{current, deferred_free};
/// use std::sync::Arc;
///
/// let token = Arc::new(());
/// let shared = deferred_free::Shared::new(token.clone());
/// current::set_on_path(true);
/// drop((shared.clone(), shared));
/// current::set_on_path(false);
/// deferred_free::collect();
/// assert_eq!(Arc::strong_count(&token), 1);
/// ```
///
/// # Invariants
///
/// `inner` comes from a leaked box, and stays valid until the count of owners, this one included,
/// is 0. The last owner retires it.
pub struct Shared<T> {
    inner: NonNull<Inner<T>>,
    owns: PhantomData<Inner<T>>,
}

#[repr(C)]
struct Inner<T> {
    /// First, so that its address is that of the whole structure.
    retired: Retired,
    owners: AtomicUsize,
    value: T,
}

// SAFETY: `new` requires a value that may be used and dropped on any thread; the rest is atomic.
unsafe impl<T: Send + Sync> Send for Shared<T> {}
// SAFETY: `&Shared` gives `&T`, and clones that any thread may drop: the value may be used and
// dropped on any thread, and the count of owners is atomic.
unsafe impl<T: Send + Sync> Sync for Shared<T> {}

impl<T: Send + Sync> Shared<T> {
    /// The first owner of `value`. Allocates.
    pub fn new(value: T) -> Self
    where
        T: 'static,
    {
        // SAFETY: the value borrows nothing.
        unsafe { Self::borrowing(value) }
    }

    /// As [`new`](Self::new), of a value that may borrow.
    ///
    /// # Safety
    ///
    /// The drop of the value, which may come after all that it borrows has gone, uses nothing of
    /// that.
    pub unsafe fn borrowing(value: T) -> Self {
        // SAFETY: the caller promises what is demanded there.
        unsafe { Self::make(|_| value) }
    }

    /// As [`borrowing`](Self::borrowing), of a value that knows the pointer of its owners.
    ///
    /// # Safety
    ///
    /// As there: the drop of the value uses nothing that it borrows.
    unsafe fn make(value: impl FnOnce(*const ()) -> T) -> Self {
        let mut place = Box::<Inner<T>>::new_uninit();
        place.write(Inner {
            retired: Retired::new(free::<T>),
            owners: AtomicUsize::new(1),
            value: value(place.as_ptr().cast()),
        });
        Self {
            // SAFETY: it was just written.
            inner: NonNull::from(Box::leak(unsafe { place.assume_init() })),
            owns: PhantomData,
        }
    }
}

impl<T: Send + Sync + 'static> Shared<T> {
    /// As [`new`](Self::new), of a value that knows the [pointer](Self::from_raw) of its owners.
    /// The pointer may be used when this has returned.
    pub(crate) fn new_cyclic(value: impl FnOnce(*const ()) -> T) -> Self {
        // SAFETY: the value borrows nothing.
        unsafe { Self::make(value) }
    }
}

impl<T> Shared<T> {
    fn inner(&self) -> &Inner<T> {
        // SAFETY: by the type's invariant the allocation is valid while this owner exists.
        unsafe { self.inner.as_ref() }
    }

    /// Whether there is no other owner. If so there will be none until this one is cloned.
    pub fn is_only(&self) -> bool {
        self.inner().owners.load(Ordering::Acquire) == 1
    }

    /// Turns the owner into a pointer, for [`from_raw`](Self::from_raw).
    pub(crate) fn into_raw(self) -> *const () {
        ManuallyDrop::new(self).inner.as_ptr().cast_const().cast()
    }

    /// The owner that was turned into a pointer.
    ///
    /// # Safety
    ///
    /// The pointer comes from `into_raw` of the same type, and is used once.
    pub(crate) unsafe fn from_raw(raw: *const ()) -> Self {
        Self {
            // SAFETY: the caller promises that the pointer is from `into_raw`, so it is that of a
            // live allocation and not null.
            inner: unsafe { NonNull::new_unchecked(raw.cast_mut().cast()) },
            owns: PhantomData,
        }
    }
}

/// # Safety
///
/// `head` begins an `Inner<T>` that has no owner any more.
unsafe fn free<T>(head: NonNull<Retired>) {
    // SAFETY: the caller promises that the `Inner<T>` has no owner; `new` made it from a box.
    drop(unsafe { Box::from_raw(head.cast::<Inner<T>>().as_ptr()) });
}

impl<T> Clone for Shared<T> {
    #[inline]
    fn clone(&self) -> Self {
        // Relaxed: the cloned owner keeps the value alive.
        if self.inner().owners.fetch_add(1, Ordering::Relaxed) > isize::MAX as usize {
            // So many owners were leaked: if the count wrapped, a value with owners would be freed.
            luna_platform::panics::abort();
        }
        Self {
            inner: self.inner,
            owns: PhantomData,
        }
    }
}

impl<T> Drop for Shared<T> {
    #[inline]
    fn drop(&mut self) {
        // AcqRel: all other owners' uses of the value happen before it is dropped. No separate
        // fence for the last owner: ThreadSanitizer does not understand fences.
        if self.inner().owners.fetch_sub(1, Ordering::AcqRel) == 1 {
            // SAFETY: there is no owner any more, and the bounds of `new` allow freeing it on any
            // thread and at any time.
            unsafe { retire(self.inner.cast()) };
        }
    }
}

impl<T> Deref for Shared<T> {
    type Target = T;
    #[inline]
    fn deref(&self) -> &T {
        &self.inner().value
    }
}

impl<T: fmt::Debug> fmt::Debug for Shared<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use crate::current::set_on_path;
    use alloc::sync::Arc;

    #[test]
    fn the_last_owner_ends_it_at_once_off_the_path() {
        let token = Arc::new(());
        let shared = Shared::new(token.clone());
        let other = shared.clone();
        assert!(!shared.is_only());
        drop(other);
        assert!(shared.is_only());
        assert_eq!(Arc::strong_count(&token), 2);
        drop(shared);
        assert_eq!(Arc::strong_count(&token), 1);
    }

    /// The `collect` of another test may end it a moment earlier, but never on the path.
    #[test]
    fn on_the_path_its_end_is_put_off() {
        struct Noting(Arc<AtomicUsize>);
        impl Drop for Noting {
            fn drop(&mut self) {
                assert!(!crate::current::on_path());
                self.0.fetch_add(1, Ordering::SeqCst);
            }
        }
        let dropped = Arc::new(AtomicUsize::new(0));
        let shared = Shared::new(Noting(dropped.clone()));
        set_on_path(true);
        drop((shared.clone(), shared));
        set_on_path(false);
        super::super::collect();
        while dropped.load(Ordering::SeqCst) == 0 {
            // The `collect` of another test is freeing it.
            std::thread::yield_now();
        }
    }

    #[test]
    fn owners_on_many_threads_end_it_once() {
        for _ in 0..200 {
            let token = Arc::new(());
            let shared = Shared::new(token.clone());
            std::thread::scope(|scope| {
                for _ in 0..3 {
                    let own = shared.clone();
                    scope.spawn(move || drop((own.clone(), own)));
                }
                drop(shared);
            });
            assert_eq!(Arc::strong_count(&token), 1);
        }
    }
}
