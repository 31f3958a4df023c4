//! One hop to another computer: a value each way in each cycle, over UDP.
//!
//! A [`CycleLink`] connects two computers on a wire of their own. In each cycle each side sends one
//! datagram with its newest value, without waiting. What is received is a [`Sample`]: the value,
//! its sequence number, how many were lost before it, and its age with the error of that. The last
//! two come from stamps: each datagram states when it was sent, and when the partner's last one came.
//! So each datagram measures the offset of the other clock, between bounds that hold however long
//! the network takes.
//!
//! ```
//! use luna::prelude::*;
//! use luna_links::cycle::{CycleLink, Settings};
//! use std::net::UdpSocket;
//! use std::time::Duration;
//!
//! luna_links::cycle_data! {
//!     /// What the arm is to do.
//!     #[derive(Debug, Clone, Copy, PartialEq)]
//!     pub struct Command: "doc/command", version 1 { pub target: f64 }
//! }
//! luna_links::cycle_data! {
//!     /// Where the arm is.
//!     #[derive(Debug, Clone, Copy, PartialEq)]
//!     pub struct State: "doc/state", version 1 { pub position: f64, pub moved: u32 }
//! }
//!
//! // Two computers would call `CycleLink::open` with their addresses.
//! let (here, there) = (UdpSocket::bind("127.0.0.1:0")?, UdpSocket::bind("127.0.0.1:0")?);
//! let (near, far) = (here.local_addr()?, there.local_addr()?);
//! let period = Duration::from_millis(1);
//! // On the wire five cycles are much; on a busy machine they are not.
//! let settings = Settings::new(period).stale_after(30_000);
//! let mut planner = CycleLink::<Command, State>::over(here, far, &settings)?;
//! let mut arm = CycleLink::<State, Command>::over(there, near, &settings)?;
//!
//! let mut system = System::new("cell");
//! let main = system.executor("main").build()?;
//! main.process("planner").spawn(async move {
//!     let mut tick = luna::periodic("planner", period)?;
//!     loop {
//!         tick.next().await;
//!         planner.send(&Command { target: 0.5 })?;
//!         let Some(sample) = planner.newest()? else { continue };
//!         if sample.value.moved == 3 {
//!             let age = sample.age.expect("no clock was set");
//!             println!("{} lost; {:?} old, ± {:?}", sample.lost_before, age.time, age.error);
//!             return Ok(());
//!         }
//!     }
//! })?;
//! main.process("arm").spawn(async move {
//!     let mut tick = luna::periodic("arm", period)?;
//!     let mut state = State { position: 0.0, moved: 0 };
//!     while state.moved < 3 {
//!         tick.next().await;
//!         if let Some(sample) = arm.newest()? {
//!             state.position = sample.value.target;
//!             state.moved += 1;
//!         }
//!         arm.send(&state)?;
//!     }
//!     Ok(())
//! })?;
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```
//!
//! # What holds
//!
//! - Values come in order, each once, never one of an earlier opening of either side. One that
//!   overtakes others makes those lost. [`Status`] counts all of it.
//! - A partner that was restarted is a new session. It is heard when the one before has been silent
//!   for the limit of the [`Settings`], and has answered a datagram of this side.
//! - Bytes that are no datagram of the protocol, of another type or another session are counted,
//!   and never decoded as a value.
//! - Nothing is encrypted or signed. The socket receives only from the partner's address, but on a
//!   network that others use an address can be forged: take a wire of your own.
//!
//! A [`Protocol`] is the same without a socket, for simulations and other wires. The page
//! `docs/clocks.md` of the repository has the clocks.

mod data;
mod datagram;
mod error;
mod estimate;
mod link;
mod partner;
mod process;
mod protocol;
mod sample;
mod settings;
mod socket;
mod status;

pub use data::{CycleData, Field, TypeIdentity};
pub use datagram::MAX_SIZE;
pub use error::CycleError;
pub use estimate::Offset;
pub use link::CycleLink;
#[doc(no_inline)]
pub use luna::external::{FromBytes, Malformed, ToBytes};
pub use process::{CycleProcess, OnStale, Reading};
pub use protocol::{Moment, Protocol, Received};
pub use sample::{Converted, Measured, Sample, Silence};
pub use settings::Settings;
pub use socket::Sent;
pub use status::Status;
