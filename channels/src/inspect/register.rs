//! The register of the wait points.

use super::{NonNull, WaitPoint};
use alloc::collections::BTreeMap;
use alloc::vec::Vec;
use core::panic::Location;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A wait point that lives, and stays where it is.
struct Registered(NonNull<WaitPoint>);

// SAFETY: a wait point is shared by its lock, and registered only while it lives.
unsafe impl Send for Registered {}

/// All live wait points, by their numbers: in the order in which they were made.
static WAIT_POINTS: Mutex<BTreeMap<u64, Registered>> = Mutex::new(BTreeMap::new());

fn registered() -> MutexGuard<'static, BTreeMap<u64, Registered>> {
    WAIT_POINTS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// How many wait points were made in each line of the program.
static MADE: Mutex<BTreeMap<(&str, u32), u16>> = Mutex::new(BTreeMap::new());

/// How many wait points were made in this line, with the one that is being made.
pub(super) fn nth_at(made_at: &'static Location<'static>) -> u16 {
    // Models name nothing.
    if cfg!(loom) {
        return 1;
    }
    let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
    let nth = made.entry((made_at.file(), made_at.line())).or_default();
    *nth = nth.saturating_add(1);
    *nth
}

/// Registers a wait point. Off the real-time path, as is making one.
///
/// # Safety
///
/// The wait point stays where it is, and lives until it is unregistered. Its method `stored` can be
/// called for it, by this pointer, under its lock.
pub(crate) unsafe fn register(wait_point: NonNull<WaitPoint>) {
    // A model makes and drops thousands of channels, and their locks belong to one run of it.
    if !cfg!(loom) {
        // SAFETY: the wait point lives until it is unregistered, as is demanded here.
        let id = unsafe { wait_point.as_ref() }.identity.id;
        registered().insert(id, Registered(wait_point));
    }
}

/// Takes a wait point off the register, as it is freed.
pub(crate) fn unregister(wait_point: &WaitPoint) {
    if !cfg!(loom) {
        registered().remove(&wait_point.identity.id);
    }
}

/// What `look` makes of each registered wait point, in their order. None leaves meanwhile.
pub(super) fn collect<V>(mut look: impl FnMut(NonNull<WaitPoint>) -> V) -> Vec<V> {
    registered().values().map(|one| look(one.0)).collect()
}
