//! A simulated bus, as a process between nodes.
//!
//! It needs no hardware and no privilege, and runs on LUNA's clock: on a virtual one a test of an
//! hour takes a moment, and is the same each time.
//!
//! ```
//! use luna::prelude::*;
//! use luna_can::{Filter, Frame, sim};
//!
//! let mut system = System::new("two nodes");
//! system.virtual_clock();
//! let mut bus = sim::Bus::new(500_000)?;
//! let left = bus.open(&system.devices(), "left")?;
//! let right = bus.open(&system.devices(), "right")?;
//! let main = system.executor("main").build()?;
//! main.process("bus").spawn(bus)?;
//!
//! let (send, outgoing) = luna::channel::<Frame>();
//! let (incoming, received) = luna::buffered::<Frame>(Buffer::fifo(8));
//! main.process("left").spawn(luna_can::controller(&left).send(outgoing))?;
//! main.process("right").spawn(luna_can::controller(&right).receive(&[Filter::ANY], incoming))?;
//! # drop((left, right));
//! main.process("user").spawn(async move {
//!     let frame = Frame::standard(0x123, &[1, 2, 3]).unwrap();
//!     send.send(frame).await?;
//!     assert_eq!(received.recv().await?, frame);
//!     Ok(())
//! })?;
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```
//!
//! What it has of a real bus: the identifier decides which node goes first; a frame takes as long
//! as its bits with all that can be stuffed; a frame that is destroyed is repeated; nodes count
//! errors as the standard says, and become error passive and bus-off; a node that is alone is not
//! acknowledged; queues are bounded. It has no single bits: an error strikes a whole frame.

mod bus;
mod control;
mod node;

pub use bus::Bus;
pub use control::Control;
pub use node::Port;

use luna::devices::DeviceError;

/// Why a simulated bus cannot be so.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SimError {
    /// A bit rate of zero.
    #[error("a bus has a bit rate of at least 1 bit/s")]
    NoRate,
    /// The device manager refuses its device: a node of this name is open already, say.
    #[error("the device manager refuses it: {0}")]
    Device(#[from] DeviceError),
}

impl From<SimError> for luna::Error {
    fn from(error: SimError) -> Self {
        luna::Error::other(error)
    }
}
