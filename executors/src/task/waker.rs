//! The wakers of a task: counted pointers to it.

use super::{Task, ready_elsewhere};
use luna_core::current::{self, Place};
use luna_core::reclaim;
use std::ptr::NonNull;
use std::sync::atomic::Ordering;
use std::task::{RawWaker, RawWakerVTable, Waker};

/// How many wakers a task begins with.
pub(super) const FIRST: u32 = 1;

/// The first waker of `task`, which is counted already.
///
/// # Safety
///
/// The task begins with that count, and this is called once.
pub(super) unsafe fn first(task: NonNull<Task>) -> Waker {
    // SAFETY: the table's functions keep to the contract of wakers, from any thread, and each waker
    // is counted.
    unsafe { Waker::new(task.as_ptr().cast(), &TABLE) }
}

static TABLE: RawWakerVTable = RawWakerVTable::new(clone, wake, wake_by_ref, discard);

/// The task that a waker leads to.
///
/// # Safety
///
/// `data` is of a waker made above, so it is not null.
#[inline]
unsafe fn task(data: *const ()) -> NonNull<Task> {
    // SAFETY: the contract.
    unsafe { NonNull::new_unchecked(data.cast_mut().cast()) }
}

// SAFETY of all below: `data` belongs to a counted waker, so the task is live until that one is
// discarded.

unsafe fn clone(data: *const ()) -> RawWaker {
    // SAFETY: see above.
    unsafe { add(task(data)) };
    RawWaker::new(data, &TABLE)
}

/// Counts one more reference to the task, as a waker has one.
///
/// # Safety
///
/// The task is kept by another one.
pub(super) unsafe fn add(task: NonNull<Task>) {
    // SAFETY: the caller's contract. Relaxed: code that has a waker may pass it on, and provides
    // the ordering that this needs itself.
    let references = unsafe { &task.as_ref().references };
    if references.fetch_add(1, Ordering::Relaxed) > i32::MAX as u32 {
        // So many were leaked: to wrap would be to free what is owned.
        std::process::abort();
    }
}

unsafe fn wake(data: *const ()) {
    // SAFETY: see above.
    unsafe {
        wake_by_ref(data);
        discard(data);
    }
}

unsafe fn wake_by_ref(data: *const ()) {
    // SAFETY: see above; on the executor's own thread the task can be queued at once.
    unsafe {
        let task = task(data);
        let process = &task.as_ref().process;
        if current::home() == Some(process.home()) {
            process.ready_at(process.level(), Place::Last);
        } else {
            ready_elsewhere(task.cast(), process.level());
        }
    }
}

unsafe fn discard(data: *const ()) {
    // SAFETY: see above.
    unsafe { remove(task(data)) };
}

/// Counts one less; the last one frees the task.
///
/// # Safety
///
/// One reference was counted for the caller, which does not use the task any more.
pub(super) unsafe fn remove(task: NonNull<Task>) {
    // SAFETY: the caller's contract; after the last waker nothing uses the task. The task's own
    // waker is dropped only after its body has ended, and its process.
    unsafe {
        // AcqRel, and no fence, which ThreadSanitizer does not know: the thread that frees the task
        // does so after all that others did with it. A thread with the only waker is alone with it:
        // looking costs less than counting.
        let references = &task.as_ref().references;
        if references.load(Ordering::Acquire) == 1 || references.fetch_sub(1, Ordering::AcqRel) == 1
        {
            reclaim::retire(NonNull::new_unchecked(&raw mut (*task.as_ptr()).retired));
        }
    }
}
