//! Freeing off the real-time path.
//!
//! What a process frees as it ends (a channel whose last end it held, say) would take the allocator's lock in the middle of other
//! processes' work. On the real-time path such memory is put on a list instead, by one compare-and-swap, and freed by whoever
//! calls [`collect`] on a thread that may.

mod shared;

pub use shared::Shared;

use std::ptr::{self, NonNull};
use std::sync::atomic::{AtomicPtr, Ordering};

/// The head of an allocation that can be freed later: a field of it, from which its `free` finds the whole.
#[derive(Debug)]
pub struct Retired {
    next: AtomicPtr<Retired>,
    free: unsafe fn(NonNull<Retired>),
}

impl Retired {
    /// A head whose allocation `free` frees.
    pub const fn new(free: unsafe fn(NonNull<Retired>)) -> Self {
        Self {
            next: AtomicPtr::new(ptr::null_mut()),
            free,
        }
    }
}

static RETIRED: AtomicPtr<Retired> = AtomicPtr::new(ptr::null_mut());

/// Frees the allocation that `head` begins: at once, or on the real-time path as soon as somebody calls [`collect`]. O(1).
///
/// # Safety
///
/// `head` begins a live allocation that its function can free, on any thread, and nobody uses it any more.
pub unsafe fn retire(head: NonNull<Retired>) {
    if !crate::current::on_path() {
        // SAFETY: the caller's contract.
        unsafe {
            let free = head.as_ref().free;
            free(head);
        }
        return;
    }
    let mut first = RETIRED.load(Ordering::Relaxed);
    loop {
        // SAFETY: the allocation is ours alone until it is on the list.
        unsafe { head.as_ref() }
            .next
            .store(first, Ordering::Relaxed);
        match RETIRED.compare_exchange_weak(
            first,
            head.as_ptr(),
            Ordering::Release,
            Ordering::Relaxed,
        ) {
            Ok(_) => return,
            Err(now) => first = now,
        }
    }
}

/// Frees what was put off. Not for the real-time path: O(number of allocations put off).
pub fn collect() {
    if RETIRED.load(Ordering::Relaxed).is_null() {
        return;
    }
    let mut next = RETIRED.swap(ptr::null_mut(), Ordering::Acquire);
    while let Some(head) = NonNull::new(next) {
        // SAFETY: the swap made the whole list ours; `retire` promised that each can be freed here.
        unsafe {
            next = head.as_ref().next.load(Ordering::Relaxed);
            let free = head.as_ref().free;
            free(head);
        }
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[repr(C)]
    struct Counted {
        head: Retired,
        token: Arc<()>,
    }

    unsafe fn free(head: NonNull<Retired>) {
        // SAFETY: `retired` made it of a box of `Counted`, whose first field the head is.
        drop(unsafe { Box::from_raw(head.cast::<Counted>().as_ptr()) });
    }

    fn retired(token: &Arc<()>) -> NonNull<Retired> {
        let counted = Box::new(Counted {
            head: Retired::new(free),
            token: token.clone(),
        });
        assert_eq!(Arc::strong_count(&counted.token), Arc::strong_count(token));
        NonNull::from(Box::leak(counted)).cast()
    }

    #[test]
    fn frees_at_once_off_the_path_and_later_on_it() {
        let token = Arc::new(());
        // SAFETY: nobody else knows the allocation.
        unsafe { retire(retired(&token)) };
        assert_eq!(Arc::strong_count(&token), 1);

        crate::current::set_on_path(true);
        // SAFETY: nobody else knows the allocation.
        unsafe { retire(retired(&token)) };
        // Another test's `collect` frees this one's too only once it is on the list, so two references are the most.
        crate::current::set_on_path(false);
        collect();
        assert_eq!(Arc::strong_count(&token), 1);
    }
}
