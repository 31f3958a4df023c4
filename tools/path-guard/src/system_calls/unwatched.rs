//! Where system calls cannot be watched.

use super::Selector;

/// # Safety
///
/// None is needed here.
pub(crate) unsafe fn arm(_: &Selector) {}

pub(crate) fn availability() -> Result<(), String> {
    Err(format!(
        "system calls, sleeps, and locks other than LUNA's are not watched on {} {}: it needs Linux on x86-64",
        std::env::consts::ARCH,
        std::env::consts::OS
    ))
}

pub(crate) fn probe() {}
