//! TAI, the time that computers can have in common, and what the kernel knows of its error.

use core::time::Duration;
use std::io::Result;

/// What the kernel knows of its wall clocks, as the daemon that disciplines them (chrony, ptp4l
/// with phc2sys, ntpd) has set it. The kernel lets the greatest error grow by 0.5 ms a second until
/// the daemon states it again.
///
/// ```
/// use luna_machine::tai::Synchronization;
///
/// // Not everywhere: a sandbox may refuse the call.
/// if let Ok(state) = Synchronization::of_machine() {
///     println!("TAI is {} s ahead of UTC, ± {:?}", state.tai_offset, state.greatest_error);
/// }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Synchronization {
    /// Seconds by which the machine's TAI is ahead of its UTC: 37 since 2017. 0 if nothing has set
    /// it; CLOCK_TAI is then UTC under another name.
    pub tai_offset: i32,
    /// Whether a daemon keeps the clocks, and has done so lately.
    pub is_synchronized: bool,
    /// The greatest error of the wall clocks. Meaningless unless they are synchronized.
    pub greatest_error: Duration,
    /// The error that the daemon expects.
    pub estimated_error: Duration,
}

impl Synchronization {
    /// Reads it: one system call that never waits, needs no privilege, and changes nothing. Where a
    /// loop calls it, once a second is enough.
    ///
    /// # Errors
    ///
    /// The error of the system: `Unsupported` on the portable backend, `PermissionDenied` or
    /// `Unsupported` where a sandbox refuses the call.
    pub fn of_machine() -> Result<Self> {
        crate::backend::tai::synchronization()
    }
}

/// `CLOCK_TAI`, in nanoseconds since 1970. Real-time path: yes; O(1), no system call where the
/// kernel offers a vDSO.
///
/// # Errors
///
/// The error of the system: `Unsupported` on the portable backend.
///
/// ```
/// if let Ok(now) = luna_machine::tai::tai_nanos() {
///     assert!(now > 0);
/// }
/// ```
pub use crate::backend::tai::tai_nanos;
