//! The standard library knows how many threads can run at once, and nothing else of the machine.

use crate::facts::ClockResolution;

/// There are no files of the kernel.
pub(crate) const ROOT: Option<&str> = None;

pub(crate) fn clock_resolution() -> Option<ClockResolution> {
    None
}
