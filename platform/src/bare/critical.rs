//! The critical section of all locks.
//!
//! Sections of the crate `critical-section` end in the reverse order of their begin; guards of
//! locks end in any order. So the first lock begins the one section, and the last that is left ends
//! it.
//!
//! Guards of locks and the sections of other code must not overlap in part: to leave the last guard
//! within a section of other code would end that section, and a guard that outlives the section in
//! which it was made would hold nothing. How a chip says that interrupts are disabled is unknown
//! here, so this is not checked: the caller of `install` promises it. LUNA's own guards are made and
//! left within one call.

use core::cell::Cell;
use critical_section::RestoreState;

struct Section {
    locks: Cell<usize>,
    /// What the section's end restores; of the first lock.
    restores: Cell<RestoreState>,
}

// SAFETY: it is used within the critical section alone.
unsafe impl Sync for Section {}

static SECTION: Section = Section {
    locks: Cell::new(0),
    restores: Cell::new(RestoreState::invalid()),
};

/// One more lock is held.
#[inline]
pub(super) fn enter() {
    // SAFETY: it is released below, if it lies within another, or by the `leave` of the last lock.
    // Sections of other code lie wholly within it or around it: the caller of `install` has
    // promised that.
    let restores = unsafe { critical_section::acquire() };
    let locks = SECTION.locks.get();
    SECTION.locks.set(locks + 1);
    if locks == 0 {
        SECTION.restores.set(restores);
    } else {
        // SAFETY: of the section that was acquired just now, within that of the first lock.
        unsafe { critical_section::release(restores) };
    }
}

/// One lock less is held.
///
/// # Safety
///
/// The caller has [entered](enter), and leaves once.
#[inline]
pub(super) unsafe fn leave() {
    let locks = SECTION.locks.get() - 1;
    SECTION.locks.set(locks);
    if locks == 0 {
        // SAFETY: the first lock has acquired it, and the caller was the last that relied on it.
        unsafe { critical_section::release(SECTION.restores.get()) };
    }
}
