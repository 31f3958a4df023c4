//! EtherCAT for LUNA.

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
pub mod sim;
mod socket;
mod state;
mod timer;
mod value;

pub use bus::{Bus, BusDevice, open, scan};
pub use error::{LinkError, OpenError, Place, StepError};
pub use expected::{Expected, Found};
pub use fault::Fault;
pub use health::Health;
pub use link::Link;
pub use neutral::Neutral;
pub use port::Wire;
pub use process::BusProcess;
pub use sample::Sample;
pub use state::State;
pub use value::Value;
