//! The object that the current process waits for: noted by its operations as they return `Pending`,
//! reported at the end of the turn.
//!
//! Only one object is reported. A process that waits for two waits for several, and must not be
//! shown as waiting for one of them; so a wait for something without a number is noted too. An
//! operation that gives up in the turn, or completes in it after all, takes its note back.

use super::{Kind, code, is_on};
use core::cell::Cell;

luna_platform::local! {
    static WAITS: Cell<Noted> = const { Cell::new(Noted::NOTHING) };
}

/// A note: kind and number in one word.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Noted(u64);

impl Noted {
    const NOTHING: Noted = Noted(0);
    const SEVERAL: Noted = Noted(u64::MAX);
    /// No wait: the body has failed.
    const FAILED: Noted = Noted(u64::MAX - 1);
    /// One object without a number.
    const OTHER: Noted = Noted(u64::MAX - 2);

    fn of((kind, number): (Kind, u32)) -> Self {
        Noted((kind as u64) << 32 | u64::from(number))
    }
}

/// Notes what the current process waits for, with an operation that is about to return `Pending`:
/// for the end of its turn.
#[inline(always)]
pub fn waits_for(what: impl FnOnce() -> (Kind, u32)) {
    if is_on() {
        note(Noted::of(what()));
    }
}

/// Notes that the current process waits for something that has no number: a time, a file, the end
/// of a process.
#[inline(always)]
pub fn waits_for_other() {
    if is_on() {
        note(Noted::OTHER);
    }
}

/// Notes that the current process waits for several things.
#[inline(always)]
pub fn waits_for_several() {
    if is_on() {
        note(Noted::SEVERAL);
    }
}

#[cold]
#[inline(never)]
fn note(new: Noted) {
    let before = WAITS.get();
    // Two without a number are not known to be the same.
    let is_same = before == new && new != Noted::OTHER;
    WAITS.set(if before == Noted::NOTHING || is_same {
        new
    } else {
        Noted::SEVERAL
    });
}

/// Takes a note back, of an operation that gives up; `None` for a wait without a number.
#[inline(always)]
pub fn waits_no_more(what: impl FnOnce() -> Option<(Kind, u32)>) {
    if is_on() {
        take_back(what().map_or(Noted::OTHER, Noted::of));
    }
}

#[cold]
#[inline(never)]
fn take_back(noted: Noted) {
    // A note of several stays: the others are unknown.
    if WAITS.get() == noted {
        WAITS.set(Noted::NOTHING);
    }
}

/// Discards the notes of `f`: an operation waits for it in addition, for instance for its deadline.
#[inline(always)]
pub fn beside<R>(f: impl FnOnce() -> R) -> R {
    if !is_on() {
        return f();
    }
    let before = WAITS.get();
    let result = f();
    WAITS.set(before);
    result
}

/// Calls `f`, a part of the current process, and returns what that part waits for then: for
/// [`code::WAITING`].
pub fn of_part<R>(f: impl FnOnce() -> R) -> (R, [u64; 2]) {
    let before = WAITS.replace(Noted::NOTHING);
    let result = f();
    let waits = arguments();
    let noted = WAITS.replace(before);
    if noted != Noted::NOTHING {
        note(noted);
    }
    (result, waits)
}

/// A turn begins.
#[inline]
pub(super) fn clear() {
    WAITS.set(Noted::NOTHING);
}

#[inline]
pub(super) fn fail() {
    WAITS.set(Noted::FAILED);
}

#[inline]
pub(super) fn has_failed() -> bool {
    WAITS.get() == Noted::FAILED
}

/// For [`code::WAITING`].
#[inline]
pub(super) fn arguments() -> [u64; 2] {
    match WAITS.get() {
        Noted::NOTHING | Noted::SEVERAL | Noted::FAILED | Noted::OTHER => [code::WAITS_UNKNOWN, 0],
        Noted(word) => [word >> 32, word & u64::from(u32::MAX)],
    }
}
