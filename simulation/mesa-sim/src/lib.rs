//! A simulated Mesa Anything I/O card: a 7I92 with encoders and PWM, on loopback.
//!
//! A [`Card`] is the card without any I/O: requests in, answers out, at times given by the caller.
//! A [`Server`] adds a socket, a [`World`] behind its pins (a plant, by [`PlantWorld`]), and a
//! [`Network`] in front that loses, delays, doubles and reorders datagrams by a seed.
//!
//! ```
//! use luna_mesa_sim::{Server, Settings};
//! use std::time::Duration;
//!
//! let card = Server::start(Settings::default())?;
//! let mut client = hostmot2::Client::connect(card.address()).unwrap();
//! let description = client.describe().unwrap();
//! assert_eq!(description.board.name, "7I92");
//! assert_eq!(description.count(hostmot2::idrom::Tag::ENCODERS), 4);
//! # Ok::<(), std::io::Error>(())
//! ```
//!
//! # What is simulated
//!
//! The memory spaces 0 to 7 with their info areas; the IDROM; encoder counters with time stamps and
//! index; PWM values and enables; ports with directions, alternate sources and inverts; the
//! watchdog, which makes all pins inputs; EEPROM and flash memory, so that Mesa's own tool can read
//! it. Not simulated: open drain beyond its register, input filters, PWM wave forms (a duty is a
//! number), the Ethernet chip, IRQs, the other modules.

#![forbid(unsafe_code)]

mod card;
mod network;
mod server;
mod world;

pub use card::{Card, ENCODERS, PINS, PWMS, Watchdog};
pub use network::{Faults, Network, Sent};
pub use server::{Server, Settings, Traffic};
pub use world::{NoWorld, PlantWorld, World};
