//! Threads have no priorities here, so there are no boosts.

/// A thread, and its scheduling without a boost.
#[derive(Debug)]
pub struct Scheduling;

/// The scheduling of the calling thread.
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

/// Runs the thread at this priority. Refused, but in a model.
///
/// # Errors
///
/// The system's error number.
pub fn boost(_: &Scheduling, _: u8) -> Result<(), i32> {
    if cfg!(loom) { Ok(()) } else { Err(0) }
}

/// Restores the thread's own scheduling.
///
/// # Errors
///
/// None.
pub fn restore(_: &Scheduling) -> Result<(), i32> {
    Ok(())
}
