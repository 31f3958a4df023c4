//! Short wake-ups: idle cores are kept from sleeping deeply.
//!
//! A core that sleeps deeply takes tens of microseconds to wake, and so does a virtual core that
//! its host has preempted. On the reference machine the device held at 0 halves the median wake-up
//! latency, from 25 to 14 µs. It costs power.

use crate::backend::latency as backend;
use crate::shortfall::Shortfall;

/// Keeps `/dev/cpu_dma_latency` at 0 µs while it lives.
///
/// Several may live at once, in one process or many: the kernel takes the least of all wishes.
/// Opening and closing are two system calls each; not for the real-time path.
///
/// ```
/// use luna_machine::latency::DmaLatency;
///
/// match DmaLatency::hold() {
///     Ok(held) => drop(held), // hold it as long as real-time threads run
///     Err(shortfall) => eprintln!("{shortfall}"),
/// }
/// ```
#[derive(Debug)]
#[must_use = "the device is given back when this is dropped"]
pub struct DmaLatency {
    _held: backend::Held,
}

impl DmaLatency {
    /// Asks for wake-ups without delay.
    ///
    /// # Errors
    ///
    /// [`Shortfall::DmaLatency`] reports why not, and how to get it.
    pub fn hold() -> Result<DmaLatency, Shortfall> {
        let held = backend::hold().map_err(Shortfall::DmaLatency)?;
        Ok(DmaLatency { _held: held })
    }
}
