//! Freeing off the real-time path.
//!
//! What a process frees as it ends (a channel whose last end it held, say) would take the allocator's lock in the middle of other
//! processes' work. On the real-time path such memory is put on a list instead, by one compare-and-swap, and freed by whoever
//! calls [`collect`] on a thread that may. An executor's thread [keeps](keep_own) some of it to itself, which costs nothing atomic: most is freed by the next spawn
//! on the same thread.

mod shared;

pub use shared::Shared;

use std::cell::Cell;
use std::marker::PhantomData;
use std::panic::{AssertUnwindSafe, catch_unwind};
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

/// How many allocations a thread keeps to itself at most.
const MOST_OWN: u32 = 64;

/// What a thread keeps to itself: a chain from `first` to `last`, of so many; null if there is none.
struct Own {
    keeps: Cell<bool>,
    count: Cell<u32>,
    first: Cell<*mut Retired>,
    last: Cell<*mut Retired>,
}

thread_local! {
    static OWN: Own = const {
        Own {
            keeps: Cell::new(false),
            count: Cell::new(0),
            first: Cell::new(ptr::null_mut()),
            last: Cell::new(ptr::null_mut()),
        }
    };
}

/// Until the guard is dropped the thread keeps some of what it retires on the real-time path to itself, and hands it over to the others in
/// [`hand_over`]: to be called before it sleeps.
pub fn keep_own() -> KeepsOwn {
    OWN.with(|own| own.keeps.set(true));
    KeepsOwn {
        stays_on_its_thread: PhantomData,
    }
}

/// The guard of [`keep_own`].
#[derive(Debug)]
#[must_use = "what is kept is handed over when the guard is dropped"]
pub struct KeepsOwn {
    stays_on_its_thread: PhantomData<*const ()>,
}

impl Drop for KeepsOwn {
    fn drop(&mut self) {
        OWN.with(|own| own.keeps.set(false));
        hand_over();
    }
}

/// Leaves what this thread keeps to whoever calls [`collect`]. Real-time path: yes; O(1).
#[inline]
pub fn hand_over() {
    OWN.with(|own| {
        let first = own.first.replace(ptr::null_mut());
        if let (Some(first), Some(last)) = (NonNull::new(first), NonNull::new(own.last.get())) {
            own.count.set(0);
            // SAFETY: the chain is this thread's alone, and no longer here.
            unsafe { publish(first, last) };
        }
    });
}

/// Puts a chain on the list.
///
/// # Safety
///
/// `first` leads to `last`, and nobody else knows of them.
unsafe fn publish(first: NonNull<Retired>, last: NonNull<Retired>) {
    let mut before = RETIRED.load(Ordering::Relaxed);
    loop {
        // SAFETY: the allocation is ours alone until it is on the list.
        unsafe { last.as_ref() }
            .next
            .store(before, Ordering::Relaxed);
        match RETIRED.compare_exchange_weak(
            before,
            first.as_ptr(),
            Ordering::Release,
            Ordering::Relaxed,
        ) {
            Ok(_) => return,
            Err(now) => before = now,
        }
    }
}

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
    let is_kept = OWN.with(|own| {
        if !own.keeps.get() || own.count.get() == MOST_OWN {
            return false;
        }
        let first = own.first.replace(head.as_ptr());
        if first.is_null() {
            own.last.set(head.as_ptr());
        }
        // SAFETY: the allocation is ours alone.
        unsafe { head.as_ref() }
            .next
            .store(first, Ordering::Relaxed);
        own.count.set(own.count.get() + 1);
        true
    });
    if !is_kept {
        // SAFETY: the allocation is ours alone.
        unsafe { publish(head, head) };
    }
}

/// Frees what was put off, but for what other threads keep to themselves. A panic in the drop of what one holds, which the panic hook tells, keeps nobody: the others are
/// freed all the same. Not for the real-time path: O(number of allocations put off).
pub fn collect() {
    let own = OWN.with(|own| {
        own.count.set(0);
        own.first.replace(ptr::null_mut())
    });
    // SAFETY: it was this thread's alone, and is no longer kept.
    unsafe { free_all(own) };
    if RETIRED.load(Ordering::Relaxed).is_null() {
        return;
    }
    // SAFETY: the swap makes the whole list ours.
    unsafe { free_all(RETIRED.swap(ptr::null_mut(), Ordering::Acquire)) };
}

/// # Safety
///
/// The chain that begins at `first` is the caller's.
unsafe fn free_all(first: *mut Retired) {
    let mut next = first;
    while let Some(head) = NonNull::new(next) {
        // SAFETY: the contract; `retire` promised that each can be freed here.
        unsafe {
            next = head.as_ref().next.load(Ordering::Relaxed);
            free_one(head);
        }
    }
}

/// # Safety
///
/// As for [`retire`].
unsafe fn free_one(head: NonNull<Retired>) {
    // SAFETY: the contract.
    let free = || unsafe {
        let free = head.as_ref().free;
        free(head);
    };
    if cfg!(any(loom, shuttle)) {
        // A model says by a panic what it has found.
        free();
    } else if let Err(payload) = catch_unwind(AssertUnwindSafe(free)) {
        // Its drop is the user's code too.
        std::mem::forget(payload);
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

    unsafe fn free_and_panic(head: NonNull<Retired>) {
        // SAFETY: as above.
        unsafe { free(head) };
        panic!("on purpose");
    }

    fn retired(token: &Arc<()>) -> NonNull<Retired> {
        retired_with(token, free)
    }

    fn retired_with(token: &Arc<()>, free: unsafe fn(NonNull<Retired>)) -> NonNull<Retired> {
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

    #[test]
    fn one_whose_drop_panics_keeps_nobody() {
        let token = Arc::new(());
        let _keeps = keep_own();
        crate::current::set_on_path(true);
        for free in [free, free_and_panic, free] {
            // SAFETY: nobody else knows the allocation.
            unsafe { retire(retired_with(&token, free)) };
        }
        crate::current::set_on_path(false);
        collect();
        assert_eq!(Arc::strong_count(&token), 1);
    }

    #[test]
    fn what_a_thread_keeps_is_freed_by_itself_or_handed_over() {
        let token = Arc::new(());
        // Nobody else frees what is kept, whatever other tests collect.
        let kept = || Arc::strong_count(&token) - 1;
        // What is handed over may be another test's to free.
        let until_all_are_freed = || {
            while kept() > 0 {
                collect();
                std::thread::yield_now();
            }
        };
        let keeps = keep_own();
        crate::current::set_on_path(true);
        for _ in 0..3 {
            // SAFETY: nobody else knows the allocation.
            unsafe { retire(retired(&token)) };
        }
        assert_eq!(kept(), 3);
        collect();
        assert_eq!(kept(), 0);
        for _ in 0..2 {
            // SAFETY: nobody else knows the allocation.
            unsafe { retire(retired(&token)) };
        }
        hand_over();
        hand_over();
        until_all_are_freed();
        for _ in 0..2 * MOST_OWN {
            // SAFETY: nobody else knows the allocation.
            unsafe { retire(retired(&token)) };
        }
        assert!(kept() >= MOST_OWN as usize, "the others are on the list");
        drop(keeps);
        crate::current::set_on_path(false);
        until_all_are_freed();
    }
}
