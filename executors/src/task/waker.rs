//! The wakers of a task: pointers to it, counted in its record.

use super::{Task, ready_elsewhere};
use crate::process::Record;
use luna_core::current::{self, QueueEnd};
use std::ptr::NonNull;
use std::task::{RawWaker, RawWakerVTable, Waker};

/// The waker of the process of `task`: it takes over the reference that is counted for the process.
///
/// # Safety
///
/// This is called once.
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
    unsafe { Task::record(task(data)).as_ref() }.count_one_more();
    RawWaker::new(data, &TABLE)
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
        if current::executor_id() == Some(process.executor_id()) {
            process.ready_at(process.level(), QueueEnd::Back);
        } else {
            ready_elsewhere(task.cast(), process.level());
        }
    }
}

unsafe fn discard(data: *const ()) {
    // SAFETY: see above; this one is not used any more.
    unsafe { Record::count_less(Task::record(task(data)), 1) };
}
