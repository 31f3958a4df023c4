//! Deferred free: memory is freed off the real-time path.
//!
//! A process that ends may free memory, for instance a channel with no other end. That would take
//! the allocator's lock in the middle of other processes' work. On the real-time path such memory
//! is put on a list instead, by one compare-and-swap. A thread off the path that calls [`collect`]
//! frees it: the next spawn does.

mod shared;

pub use shared::Shared;

use core::ptr::{self, NonNull};
use core::sync::atomic::{AtomicPtr, Ordering};
use luna_platform::panics::catch_unwind;

/// The head of an allocation that can be freed later: a field of it, from which `free` finds the
/// whole.
#[derive(Debug)]
pub struct Retired {
    next: AtomicPtr<Retired>,
    free: unsafe fn(NonNull<Retired>),
}

impl Retired {
    /// The head of an allocation that `free` frees.
    pub const fn new(free: unsafe fn(NonNull<Retired>)) -> Self {
        Self {
            next: AtomicPtr::new(ptr::null_mut()),
            free,
        }
    }
}

static RETIRED: AtomicPtr<Retired> = AtomicPtr::new(ptr::null_mut());

/// Frees the allocation that `head` begins: at once, or on the real-time path at the next
/// [`collect`]. O(1).
///
/// # Safety
///
/// `head` begins a live allocation that its function can free, on any thread, and that is no longer
/// used.
pub unsafe fn retire(head: NonNull<Retired>) {
    if !crate::current::on_path() {
        // SAFETY: the caller promises that the allocation is live, unused, and can be freed on any
        // thread.
        return unsafe { free(head) };
    }
    let mut before = RETIRED.load(Ordering::Relaxed);
    loop {
        // SAFETY: the caller has passed on the allocation, and it is on no list yet.
        unsafe { head.as_ref() }
            .next
            .store(before, Ordering::Relaxed);
        match RETIRED.compare_exchange_weak(
            before,
            head.as_ptr(),
            Ordering::Release,
            Ordering::Relaxed,
        ) {
            Ok(_) => return,
            Err(now) => before = now,
        }
    }
}

/// As [`retire`], at once: not for the real-time path.
///
/// # Safety
///
/// As for [`retire`]: `head` begins a live allocation that its function can free, on this thread,
/// and that is no longer used.
#[inline]
pub unsafe fn free(head: NonNull<Retired>) {
    // SAFETY: the caller promises that the allocation is live, unused, and can be freed here.
    unsafe { (head.as_ref().free)(head) };
}

/// Frees all deferred allocations. A panic in a drop is reported by the panic hook, and the
/// remaining allocations are freed all the same. Not for the real-time path: O(number of deferred
/// allocations).
#[cfg_attr(
    not(feature = "std"),
    doc = "In an interrupt it does nothing: the program is to free."
)]
pub fn collect() {
    #[cfg(not(feature = "std"))]
    if luna_platform::bare::is_interrupt() {
        return;
    }
    if RETIRED.load(Ordering::Relaxed).is_null() {
        return;
    }
    // SAFETY: the swap takes the whole list, so it is this thread's alone.
    unsafe { free_all(RETIRED.swap(ptr::null_mut(), Ordering::Acquire)) };
}

/// # Safety
///
/// The caller owns the chain that begins at `first`.
unsafe fn free_all(first: *mut Retired) {
    let mut next = first;
    while let Some(head) = NonNull::new(next) {
        // SAFETY: the caller owns the chain, so the allocation is live.
        next = unsafe { head.as_ref() }.next.load(Ordering::Relaxed);
        // SAFETY: the caller owns the chain; the callers of `retire` promised that each allocation
        // can be freed here.
        let free = || unsafe { free(head) };
        if cfg!(any(loom, shuttle)) {
            // A model checker reports its findings by a panic: let it through.
            free();
        } else if let Err(payload) = catch_unwind(free) {
            // The drop of the payload is user code too, and may panic.
            core::mem::forget(payload);
        }
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use alloc::sync::Arc;

    #[repr(C)]
    struct Counted {
        head: Retired,
        token: Arc<()>,
    }

    unsafe fn free(head: NonNull<Retired>) {
        // SAFETY: `retire_one` made it from a box of `Counted`, the first field of which is the
        // head.
        drop(unsafe { Box::from_raw(head.cast::<Counted>().as_ptr()) });
    }

    unsafe fn free_and_panic(head: NonNull<Retired>) {
        // SAFETY: `retire_one` made the allocation, a box of `Counted`, and uses it no more: `free`
        // needs just that.
        unsafe { free(head) };
        panic!("on purpose");
    }

    /// Retires an allocation that holds a clone of the token.
    fn retire_one(token: &Arc<()>, free: unsafe fn(NonNull<Retired>)) {
        let counted = Box::new(Counted {
            head: Retired::new(free),
            token: token.clone(),
        });
        assert_eq!(Arc::strong_count(&counted.token), Arc::strong_count(token));
        // SAFETY: no other code has a pointer to the allocation.
        unsafe { retire(NonNull::from(Box::leak(counted)).cast()) };
    }

    /// Another test's `collect` may be freeing them.
    fn until_all_are_freed(token: &Arc<()>) {
        while Arc::strong_count(token) > 1 {
            collect();
            std::thread::yield_now();
        }
    }

    #[test]
    fn frees_at_once_off_the_path_and_later_on_it() {
        let token = Arc::new(());
        retire_one(&token, free);
        assert_eq!(Arc::strong_count(&token), 1);

        crate::current::set_on_path(true);
        retire_one(&token, free);
        crate::current::set_on_path(false);
        until_all_are_freed(&token);
    }

    #[test]
    fn one_whose_drop_panics_keeps_nobody() {
        let token = Arc::new(());
        crate::current::set_on_path(true);
        for free in [free, free_and_panic, free] {
            retire_one(&token, free);
        }
        crate::current::set_on_path(false);
        until_all_are_freed(&token);
    }
}
