//! The link by which a process lies in a queue: inside the process itself, so that queueing allocates nothing.
//!
//! A link is in at most one queue at a time: what it stands for is queued once, however often it is woken. It is touched by its executor's
//! thread alone.

use std::cell::Cell;
use std::ptr::NonNull;

/// The links to the neighbours in a run queue.
#[derive(Debug)]
pub(crate) struct Link {
    next: Cell<Option<NonNull<Link>>>,
    previous: Cell<Option<NonNull<Link>>>,
}

impl Link {
    /// A link that is in no queue.
    pub(crate) const fn new() -> Self {
        Self {
            next: Cell::new(None),
            previous: Cell::new(None),
        }
    }

    /// Who comes next.
    #[inline]
    pub(crate) fn next(&self) -> Option<NonNull<Link>> {
        self.next.get()
    }

    #[inline]
    pub(crate) fn set_next(&self, next: Option<NonNull<Link>>) {
        self.next.set(next);
    }

    /// Who comes before.
    #[inline]
    pub(crate) fn previous(&self) -> Option<NonNull<Link>> {
        self.previous.get()
    }

    #[inline]
    pub(crate) fn set_previous(&self, previous: Option<NonNull<Link>>) {
        self.previous.set(previous);
    }
}
