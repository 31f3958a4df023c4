//! EtherCAT as a link driver: process data as channels, distributed clocks as the source of a loop's
//! ticks, and simulated subdevices.
//!
//! A [`Bus`] is opened at set-up ([`open`](open())): its subdevices are compared with a list, the
//! objects of that list are written ([`Expected::sdo`]), and process data is mapped, all by the
//! library ethercrab. A [`Link`] connects values of it to
//! channels. Its [`process`](Link::process) is spawned like any other: in each period it sends one
//! frame, and waits for the answer without blocking its executor. In an emergency the outputs get
//! their safe values, and the bus goes to SAFE-OP ([`Neutral`]).
//!
//! It has been tested against the simulation ([`sim`]) alone, not with real subdevices.
//!
//! ```
//! use luna::prelude::*;
//! use luna_ethercat::sim::{Network, Servo, SubDevice};
//! use luna_ethercat::{Expected, Sample, Wire};
//! use std::time::Duration;
//!
//! // In place of `Wire::interface("eth0")`.
//! let network = Network::on_virtual_time();
//! network.add(SubDevice::servo());
//! let wire = Wire::simulated(&network);
//!
//! let mut system = System::new("drive");
//! system.virtual_clock();
//! let drive = Expected::new("drive", SubDevice::VENDOR, SubDevice::SERVO);
//! let bus = luna_ethercat::open(&system.devices(), &wire, &[drive]).map_err(luna::Error::other)?;
//! let (position, positions) = luna::buffered::<Sample<i32>>(Buffer::overwrite_oldest(1));
//! let (control, controls) = luna::buffered::<u16>(Buffer::overwrite_oldest(1));
//! let (velocity, velocities) = luna::buffered::<i32>(Buffer::overwrite_oldest(1));
//! let mut link = bus.link("bus", Duration::from_millis(1));
//! link.input(0, 2, position).output(0, 0, 0, controls).output(0, 2, 0, velocities);
//! let process = link.process().map_err(luna::Error::other)?;
//!
//! let main = system.executor("main").build()?;
//! main.process("bus").spawn(process)?;
//! main.process("control").spawn(async move {
//!     while positions.recv().await?.held() < 100 {
//!         control.send(Servo::ENABLED).await?;
//!         velocity.send(5_000).await?;
//!     }
//!     Ok(())
//! })?;
//! system.run()?;
//! assert_eq!(network.written(0), [0; 6]);
//! # Ok::<(), luna::Error>(())
//! ```
//!
//! # Values
//!
//! A [`Sample`] shows whether it is fresh. When a frame is lost or late, or its working counter is
//! wrong, the last value is sent again, marked stale. Too many of these, a subdevice that leaves OP,
//! or a writer of set-points that hangs end the link: its channels are poisoned first, and then an
//! emergency is raised. The page `docs/ethercat.md` of the repository describes each failure.
//!
//! # Timers
//!
//! ethercrab is built without its feature `std`, by which its timeouts would be timers of
//! `async-io`: a hidden thread, and allocations in each cycle. They are timers of `embassy-time`,
//! for which this crate is the driver: it has the calling thread's clock and wakes nothing, since
//! the link polls after each frame and at its deadline. So a program has no other driver of
//! `embassy-time`, and nothing in it turns `ethercrab/std` on.

#![cfg(target_os = "linux")]
#![deny(unsafe_code)]

mod bus;
mod error;
mod exchange;
mod expected;
mod fault;
mod frame;
mod health;
mod link;
mod neutral;
mod port;
mod process;
mod sample;
mod sdo;
pub mod sim;
mod socket;
mod state;
mod timer;
mod value;

pub use bus::{Bus, BusDevice, open, scan};
pub use error::{LinkError, OpenError, Place, SdoError, StepError};
pub use expected::{Expected, Found};
pub use fault::Fault;
pub use health::Health;
pub use link::Link;
pub use neutral::Neutral;
pub use port::Wire;
pub use process::BusProcess;
pub use sample::Sample;
pub use sdo::{Sdo, SdoValue};
pub use state::State;
pub use value::Value;

/// The programs of the page are tests.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/ethercat.md")]
struct Page;
