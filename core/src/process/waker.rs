//! The wakers of a process of an executor: pointers to it, counted as its other references are. Its
//! own one is not counted.

use super::Process;
use crate::current::{self, QueueEnd};
use core::ptr::NonNull;
use core::task::{RawWaker, RawWakerVTable, Waker};

/// The process' own waker, for [`Process::set_waker`].
///
/// # Safety
///
/// It is not dropped, and not used when the process has gone.
pub(super) unsafe fn of_itself(process: NonNull<Process>) -> Waker {
    // SAFETY: the table's functions keep to the contract of wakers, from any thread. Each clone is
    // counted, and of this one the caller promises that the process outlives it.
    unsafe { Waker::new(process.as_ptr().cast(), &TABLE) }
}

static TABLE: RawWakerVTable = RawWakerVTable::new(clone, wake, wake_by_ref, discard);

/// The process that a waker leads to.
///
/// # Safety
///
/// `data` is that of a waker of this table: the process is live as long as the waker is.
unsafe fn process<'a>(data: *const ()) -> &'a Process {
    // SAFETY: the caller promises the pointer of a live process.
    unsafe { &*data.cast() }
}

unsafe fn clone(data: *const ()) -> RawWaker {
    // SAFETY: the waker of this data lives.
    unsafe { process(data) }.references.add_elsewhere();
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
    // SAFETY: the waker of this data lives.
    unsafe { process(data) }.wake();
}

unsafe fn discard(data: *const ()) {
    // SAFETY: the reference was counted for the waker of this data, which ends here. The pointer is
    // one to all of the process' memory, as the first one was.
    unsafe {
        if process(data).references.remove_elsewhere() {
            Process::free(NonNull::new_unchecked(data.cast_mut().cast()));
        }
    }
}

impl Process {
    /// Readies a process of an executor that was built, or makes it yield if it wakes itself. From
    /// any thread.
    pub(super) fn wake(&self) {
        debug_assert!(self.is_owned());
        if self.yields_to_wake() {
            // It is queued when its turn is over.
        } else if current::executor_id() == Some(self.executor_id) {
            // SAFETY: this is its executor's thread, which keeps it until it has ended, and takes
            // it out of the queue then.
            unsafe { self.ready_at(self.level(), QueueEnd::Back) };
        } else {
            // SAFETY: a caller that has a reference to it has a counted one, or is its executor's
            // thread.
            unsafe { self.ready_elsewhere(0) };
        }
    }
}
