//! A waker that panics when it is dropped.

use std::mem::ManuallyDrop;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::task::{RawWaker, RawWakerVTable, Waker};

static TABLE: RawWakerVTable = RawWakerVTable::new(
    |data| RawWaker::new(data, &TABLE),
    |_| (),
    |_| (),
    |_| assert!(std::thread::panicking(), "the waker's drop"),
);

/// Its clones panic in their drops.
pub(crate) fn panics_in_drop() -> ManuallyDrop<Waker> {
    // SAFETY: the table's functions do not use the data.
    ManuallyDrop::new(unsafe { Waker::new(std::ptr::null(), &TABLE) })
}

/// Runs what drops a clone of that waker. Says whether it has panicked.
pub(crate) fn panics(code: impl FnOnce()) -> bool {
    catch_unwind(AssertUnwindSafe(code)).is_err()
}
