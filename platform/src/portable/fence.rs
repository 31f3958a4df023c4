//! There is no asymmetric pair of fences here, so no lock is biased.

/// Asks for the heavy fence, once for the program.
pub fn prepare() {}

/// Whether the heavy fence can be had.
pub fn is_available() -> bool {
    false
}

/// Orders what this thread does for a thread that calls [`heavy`].
pub fn light() {}

/// A full fence on this thread and on each other one of the program.
pub fn heavy() {
    unreachable!("no lock is biased without it");
}
