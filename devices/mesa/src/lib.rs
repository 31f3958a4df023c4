//! Mesa Anything I/O cards over Ethernet (7I92, 7I96S, 7I76E and their like, with HostMot2) as link
//! drivers: encoders, PWM and pins as channels.
//!
//! A [`Card`] is opened at set-up ([`open`]). A [`Link`] connects its encoders, generators and pins
//! to channels. Its [`process`](Link::process) is spawned like any other: in each period it sends
//! one write and one read packet and waits for the answer without blocking its executor. In an
//! emergency the card's outputs are disabled ([`Neutral`]).
//!
//! ```
//! use luna::prelude::*;
//! use luna_mesa::{Reading, Sample};
//! use luna_mesa_sim::{PlantWorld, Server, Settings};
//! use luna_plants::PanTilt;
//! use std::time::Duration;
//!
//! // A simulated card, with a pan-tilt camera behind it.
//! let camera = Settings {
//!     world: Box::new(PlantWorld::new(PanTilt::jiwy([0, 0]))),
//!     ..Settings::default()
//! };
//! let server = Server::start(camera).unwrap();
//!
//! let mut system = System::new("pan");
//! let card = luna_mesa::open(&system.devices(), server.address()).map_err(luna::Error::other)?;
//! let (count, counts) = luna::buffered::<Sample<Reading>>(Buffer::overwrite_oldest(1));
//! let (duty, duties) = luna::buffered(Buffer::overwrite_oldest(1));
//! let mut link = card.link("card", Duration::from_millis(2));
//! link.watchdog(Duration::from_millis(500));
//! # // A busy machine keeps the simulated card from answering in time.
//! # link.tolerance(hostmot2::Bucket::new(1, 1, 1_000));
//! link.encoder(0, 1e6, count).pwm(0, duties);
//! let process = link.process().map_err(luna::Error::other)?;
//!
//! let main = system.executor("main").build()?;
//! main.process("card").spawn(process)?;
//! main.process("control").spawn(async move {
//!     let mut position = 0;
//!     while position < 100 {
//!         if let Some(reading) = counts.recv().await?.fresh() {
//!             position = reading.position;
//!         }
//!         duty.send(0.3).await?;
//!     }
//!     Ok(())
//! })?;
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```
//!
//! # Values
//!
//! A [`Sample`] shows whether it is fresh. When an answer is lost, late or foreign, the last value
//! is sent again, marked stale; a wrong one never is. A loss of trust (a position after too long a
//! silence, a card that was restarted) ends the link: its channels are poisoned first, and then an
//! emergency is raised. A writer of set-points that hangs ends it too: set-points are held for
//! [`greatest_age`](Link::greatest_age) at most. The page `docs/mesa.md` of the repository
//! describes each failure.

#![cfg(unix)]
#![forbid(unsafe_code)]

mod actuator;
mod card;
mod fault;
mod health;
mod link;
mod neutral;
mod process;
mod sample;
mod socket;

pub use actuator::Actuator;
pub use card::{Card, CardDevice, OpenError, open};
pub use fault::Fault;
pub use health::Health;
pub use hostmot2::encoder::Encoder as Reading;
pub use hostmot2::{Bucket, LayoutError};
pub use link::{Link, LinkError};
pub use neutral::Neutral;
pub use process::CardProcess;
pub use sample::Sample;

/// The programs of the page are tests.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/mesa.md")]
struct Page;
