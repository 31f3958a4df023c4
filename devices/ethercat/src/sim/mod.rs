//! Simulated subdevices: a bus without hardware, for tests of machines and of this crate.
//!
//! A [`Network`] is a line of [`SubDevice`]s. Each has the registers of a subdevice controller that
//! a bus uses (station address, states, sync managers, FMMUs, EEPROM, watchdog, distributed clock
//! with a drift), and an [`Application`] behind its process data. One with a [`Dictionary`] has a
//! mailbox too, for SDOs of up to four bytes (CoE). Faults can be injected while a bus runs. There
//! is no redundancy.
//!
//! ```
//! use luna_ethercat::sim::{Network, SubDevice};
//!
//! let network = Network::new();
//! let terminal = network.add(SubDevice::digital(8, 8));
//! let drive = network.add(SubDevice::servo().with_clock(20.0));
//! network.set_inputs(terminal, &[0b101]);
//! assert_eq!((network.inputs(terminal), drive), (vec![0b101], 1));
//! ```

mod abort;
mod application;
mod clock;
mod coe;
mod dictionary;
mod esc;
mod line;
mod network;
mod server;
mod sii;
mod subdevice;

pub use application::{Application, Nothing, Servo};
pub use dictionary::Dictionary;
pub use network::Network;
pub use server::Server;
pub use subdevice::{Identity, SubDevice};
