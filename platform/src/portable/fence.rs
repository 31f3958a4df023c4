//! There is no pair of fences of which one costs nothing, so nobody is favoured.

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
    unreachable!("nobody is favoured without it");
}
