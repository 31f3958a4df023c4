//! The link by which a process lies in a queue: inside the process itself, so that queueing allocates nothing.
//!
//! A link is in at most one queue at a time: what it stands for is queued once, however often it is woken.

use luna_platform::sync::atomic::{AtomicPtr, Ordering};
use std::ptr::{self, NonNull};

/// The links to the neighbours in a queue, and what to do when its turn comes. On a stack there is no previous one.
#[derive(Debug)]
pub(crate) struct Link {
    next: AtomicPtr<Link>,
    /// Touched by the run queue's thread alone, so the model checker need not watch it.
    previous: std::sync::atomic::AtomicPtr<Link>,
    run: unsafe fn(NonNull<Link>),
}

impl Link {
    /// A link that is in no queue. `run` is called with it when it has been taken from the run queue.
    pub(crate) fn new(run: unsafe fn(NonNull<Link>)) -> Self {
        Self {
            next: AtomicPtr::new(ptr::null_mut()),
            previous: std::sync::atomic::AtomicPtr::new(ptr::null_mut()),
            run,
        }
    }

    /// What to do when its turn comes.
    #[inline]
    pub(crate) fn run(&self) -> unsafe fn(NonNull<Link>) {
        self.run
    }

    /// Who comes next. Relaxed: the queue's own head orders the accesses.
    #[inline]
    pub(crate) fn next(&self) -> Option<NonNull<Link>> {
        NonNull::new(self.next.load(Ordering::Relaxed))
    }

    #[inline]
    pub(crate) fn set_next(&self, next: Option<NonNull<Link>>) {
        self.next.store(
            next.map_or(ptr::null_mut(), NonNull::as_ptr),
            Ordering::Relaxed,
        );
    }

    /// Who comes before, in a run queue.
    #[inline]
    pub(crate) fn previous(&self) -> Option<NonNull<Link>> {
        NonNull::new(self.previous.load(Ordering::Relaxed))
    }

    #[inline]
    pub(crate) fn set_previous(&self, previous: Option<NonNull<Link>>) {
        self.previous.store(
            previous.map_or(ptr::null_mut(), NonNull::as_ptr),
            Ordering::Relaxed,
        );
    }
}
