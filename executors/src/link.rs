//! The link by which a process lies in a queue: inside the process itself, so that queueing allocates nothing.
//!
//! A process is in at most one queue at a time: its task is scheduled once, however often it is woken.

use luna_platform::sync::atomic::{AtomicPtr, Ordering};
use std::ptr::{self, NonNull};

/// The link to the next in a queue.
#[derive(Debug)]
pub(crate) struct Link {
    next: AtomicPtr<Link>,
}

impl Link {
    pub(crate) fn new() -> Self {
        Self {
            next: AtomicPtr::new(ptr::null_mut()),
        }
    }

    /// Who comes next. Relaxed: the queue's own head orders the accesses.
    #[inline]
    pub(crate) fn next(&self) -> Option<NonNull<Link>> {
        NonNull::new(self.next.load(Ordering::Relaxed))
    }

    #[inline]
    pub(crate) fn set_next(&self, next: Option<NonNull<Link>>) {
        self.next
            .store(next.map_or(ptr::null_mut(), NonNull::as_ptr), Ordering::Relaxed);
    }
}
