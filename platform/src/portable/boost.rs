//! Threads have no priorities here, so that none is ever lent.

use crate::shortfall::PolicyRefusal;

/// A thread, and what it runs under without inheritance.
#[derive(Debug)]
pub struct Scheduling;

/// That of the calling thread.
pub fn scheduling() -> Scheduling {
    Scheduling
}

/// That of the same thread, read again.
pub fn scheduling_again(_: &Scheduling) -> Scheduling {
    Scheduling
}

impl Scheduling {
    /// The real-time priority; 0 without one.
    pub fn rank(&self) -> u8 {
        0
    }
}

/// Lets the thread run at this priority.
///
/// # Errors
///
/// The system's number for why it refused.
pub fn boost(_: &Scheduling, _: u8) -> Result<(), i32> {
    Err(0)
}

/// Lets the thread run under what was its own.
pub fn restore(_: &Scheduling) {}

/// Why a boost was refused with this number.
pub fn why_refused(_: u8, _: i32) -> PolicyRefusal {
    PolicyRefusal::Unsupported
}
