//! Where system calls cannot be watched.

use super::Selector;

/// # Safety
///
/// None is needed here.
pub(crate) unsafe fn arm(_: &Selector) {}

pub(crate) fn availability() -> Result<(), String> {
    Err("it needs Linux on x86-64".to_owned())
}

pub(crate) fn probe() {}
