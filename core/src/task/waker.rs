//! The wakers of a task: pointers to it, counted in its record.

use super::{Task, ready_elsewhere};
use crate::current::{self, QueueEnd};
use crate::deferred_free;
use crate::process::Record;
use core::ptr::NonNull;
use core::task::{RawWaker, RawWakerVTable, Waker};

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
    // SAFETY: the caller promises the data of a waker of this table: the pointer to its task, which
    // is not null.
    unsafe { NonNull::new_unchecked(data.cast_mut().cast()) }
}

// In all functions below `data` is that of a waker which is counted in the record, so the task is
// live until that waker is discarded.

unsafe fn clone(data: *const ()) -> RawWaker {
    // SAFETY: the waker of this data lives and is counted, so the task and its record are live.
    unsafe { Task::record(task(data)).as_ref() }.count_one_more();
    RawWaker::new(data, &TABLE)
}

unsafe fn wake(data: *const ()) {
    // SAFETY: the waker of this data lives until it is discarded, which is the last step.
    unsafe {
        wake_by_ref(data);
        discard(data);
    }
}

unsafe fn wake_by_ref(data: *const ()) {
    // SAFETY: the waker of this data lives and is counted, so the task is live. On its executor's
    // own thread it can be queued at once: a task that is queued is not retired. `ready_elsewhere`
    // needs a task that is referred to.
    unsafe {
        let task = task(data);
        let process = &task.as_ref().process;
        if process.yields_to_wake() {
            // It is queued when its turn is over.
        } else if current::executor_id() == Some(process.executor_id()) {
            process.ready_at(process.level(), QueueEnd::Back);
        } else {
            ready_elsewhere(task.cast(), process.level());
        }
    }
}

unsafe fn discard(data: *const ()) {
    // SAFETY: the reference was counted for the waker of this data, which ends here. The pointer is
    // one to all of the task's memory, by the task's invariant.
    unsafe { Record::count_less(Task::record(task(data)), 1, deferred_free::retire) };
}
