//! CANopen basics: network management (NMT), heartbeats, SDO, PDO, SYNC and EMCY.
//!
//! A [`Network`] is a controller with these on it. Each part is a process between channels, or a
//! handle that a process uses:
//!
//! | part | what it is | real-time path |
//! | --- | --- | --- |
//! | [`Network::nmt`] | a handle: start, stop, pre-operational, reset | yes |
//! | [`Network::heartbeats`] | a process: reports boot-ups, states, missed heartbeats; or an emergency | yes |
//! | [`Network::heartbeat`] | a process: the heartbeat of this program as a node | yes |
//! | [`Network::sdo`] | a handle: objects of a node, by one frame or in segments | no |
//! | [`Network::tpdo`], [`Network::emergencies`] | typed values by the controller | yes |
//! | [`Network::rpdo`] | a process: typed values as PDOs | yes |
//! | [`Network::sync`] | a process with a period | yes |
//! | [`PdoSetting`] | what is in a PDO, written by SDO | no |
//!
//! ```
//! use luna::prelude::*;
//! use luna_can::canopen::sim::{Access, Node};
//! use luna_can::canopen::{Network, NmtCommand, NodeId, Object};
//! use luna_can::sim;
//!
//! let mut system = System::new("one drive");
//! system.virtual_clock();
//! let mut bus = sim::Bus::new(500_000)?;
//! let master = bus.open(&system.devices(), "master")?; // Or luna_can::open(.., "can0").
//! let simulated = bus.open(&system.devices(), "drive")?;
//! let main = system.executor("main").build()?;
//! main.process("bus").spawn(bus)?;
//!
//! let drive = NodeId::new(5).unwrap();
//! let speed = Object::new(0x60FF, 0);
//! let node = Node::new(&simulated, drive).object(speed, 0_i32, Access::ReadWrite);
//! let control = node.control();
//! main.process("drive").spawn(node)?;
//!
//! let mut network = Network::new(&master);
//! let (nmt, mut sdo) = (network.nmt(), network.sdo(drive)?);
//! main.process("can").spawn(network.controller())?;
//! # drop((master, simulated));
//! main.process("user").spawn(async move {
//!     sdo.write(speed, -1_500_i32).await?;
//!     nmt.command(NmtCommand::Start, Some(drive)).await?;
//!     assert_eq!(sdo.read::<i32>(speed).await?, -1_500);
//!     assert_eq!(control.get::<i32>(speed), Some(-1_500));
//!     Ok(())
//! })?;
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```
//!
//! The coding of messages is this crate's own, some 500 lines. The package for it would be
//! `canopen-rs` (0.6). But its SDO values end at 32 bytes, and it refuses transfers that do not
//! state their size. It does not check which object an answer is for, and names 11 abort codes.
//! `zencan-common` (0.0.5) has no EMCY messages.
//!
//! Not here: block transfers, LSS, TIME, node guarding, EDS files, an object dictionary of this
//! program (but of a simulated node). It has been run against no real node yet.

mod abort;
mod client;
mod emcy;
mod heartbeat;
mod network;
mod nmt;
mod node_id;
mod object;
mod pdo;
mod sdo;
pub mod sim;
mod value;

pub use abort::AbortCode;
pub use client::{SdoClient, SdoError};
pub use emcy::Emergency;
pub use heartbeat::{HeartbeatConsumer, HeartbeatMissed, HeartbeatProducer, NodeEvent, OnMissed};
pub use network::Network;
pub use nmt::{Heartbeat, Nmt, NmtCommand, NmtState};
pub use node_id::NodeId;
pub use object::Object;
pub use pdo::{Direction, PdoError, PdoProducer, PdoSetting, SYNC, SyncProducer, Transmission};
pub use value::{PdoValue, Value};
