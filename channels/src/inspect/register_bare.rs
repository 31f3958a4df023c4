//! The register of the wait points without an operating system: a list through them. Its lock
//! disables interrupts, so nothing is allocated to enter or to leave.

use super::{NonNull, WaitPoint};
use alloc::vec::Vec;
use core::cell::Cell;
use core::panic::Location;
use luna_platform::lock::PiLock;

type Link = Cell<Option<NonNull<WaitPoint>>>;

/// A wait point's place in the register.
#[derive(Debug)]
pub(super) struct Links {
    before: Link,
    after: Link,
}

// SAFETY: the links are used under the register's lock alone.
unsafe impl Send for Links {}
// SAFETY: as above.
unsafe impl Sync for Links {}

impl Links {
    pub(super) const fn new() -> Self {
        Self {
            before: Cell::new(None),
            after: Cell::new(None),
        }
    }
}

struct Ends {
    first: Option<NonNull<WaitPoint>>,
    last: Option<NonNull<WaitPoint>>,
}

// SAFETY: a wait point is shared by its lock, and registered only while it lives.
unsafe impl Send for Ends {}

/// All live wait points, in the order in which they were registered.
static REGISTER: PiLock<Ends> = PiLock::new(Ends {
    first: None,
    last: None,
});

/// Which of those at its place a wait point is, is not counted here.
pub(super) fn nth_at(_: &'static Location<'static>) -> u16 {
    1
}

/// Registers a wait point. O(1).
///
/// # Safety
///
/// The wait point stays where it is, and lives until it is unregistered. Its method `stored` can be
/// called for it, by this pointer, under its lock.
pub(crate) unsafe fn register(wait_point: NonNull<WaitPoint>) {
    let mut ends = REGISTER.lock();
    // SAFETY: the caller promises that it lives; so do the others that are registered.
    unsafe {
        wait_point.as_ref().identity.links.before.set(ends.last);
        match ends.last {
            Some(last) => last.as_ref().identity.links.after.set(Some(wait_point)),
            None => ends.first = Some(wait_point),
        }
    }
    ends.last = Some(wait_point);
}

/// Takes a wait point, which is registered, off the register, as it is freed. O(1).
pub(crate) fn unregister(wait_point: &WaitPoint) {
    let mut ends = REGISTER.lock();
    let links = &wait_point.identity.links;
    let (before, after) = (links.before.take(), links.after.take());
    // SAFETY: its neighbours are registered, so they live.
    unsafe {
        match before {
            Some(before) => before.as_ref().identity.links.after.set(after),
            None => ends.first = after,
        }
        match after {
            Some(after) => after.as_ref().identity.links.before.set(before),
            None => ends.last = before,
        }
    }
}

/// What `look` makes of each registered wait point. None leaves meanwhile. With interrupts
/// disabled: O(wait points).
pub(super) fn collect<V>(mut look: impl FnMut(NonNull<WaitPoint>) -> V) -> Vec<V> {
    let ends = REGISTER.lock();
    let (mut views, mut next) = (Vec::new(), ends.first);
    while let Some(wait_point) = next {
        // SAFETY: it is registered, so it lives.
        next = unsafe { wait_point.as_ref() }.identity.links.after.get();
        views.push(look(wait_point));
    }
    views
}
