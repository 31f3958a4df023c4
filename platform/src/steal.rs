//! The time that a hypervisor has taken from the cores of a virtual machine.

use crate::backend::steal as backend;
use std::path::Path;
use std::time::Duration;

/// Reads the stolen time. Not for the real-time path: the kernel writes a text of all cores and
/// interrupts for each reading, which takes tens of microseconds.
///
/// ```
/// use luna_platform::steal::StealMeter;
///
/// if let Some(mut meter) = StealMeter::open() {
///     let earlier = meter.read();
///     assert!(earlier.iter().zip(&meter.read()).all(|(before, after)| before.1 <= after.1));
/// }
/// ```
#[derive(Debug)]
pub struct StealMeter {
    source: backend::Source,
}

impl StealMeter {
    /// Opens the source; `None` where the system has none.
    pub fn open() -> Option<StealMeter> {
        backend::open().map(|source| StealMeter { source })
    }

    /// Opens a file in the format of the kernel's; for tests.
    #[doc(hidden)]
    pub fn open_at(path: &Path) -> Option<StealMeter> {
        backend::open_at(path).map(|source| StealMeter { source })
    }

    /// The cores that are switched on, by the system's number of each, and what was stolen from
    /// each since the machine began. The kernel gives it in steps of 10 ms on most machines. Empty
    /// if the source cannot be read any more.
    pub fn read(&mut self) -> Vec<(usize, Duration)> {
        backend::read(&mut self.source).unwrap_or_default()
    }
}
