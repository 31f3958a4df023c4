//! Jiwy, the pan-tilt camera of the thesis (appendix A.1): its complete model as communicating
//! sequential processes.
//!
//! [`network::build`] creates the processes and connects them; `processes` has their code,
//! [`parts`] their computations. [`hardware`] has their view of the machine, and the machine:
//! processes that simulate it, or a simulator outside of the system.
//!
//! ```
//! use luna::prelude::*;
//! use luna_jiwy::{Executors, Settings, Start, hardware, joystick::Recording, network};
//! use std::time::Duration;
//!
//! let mut system = System::new("jiwy");
//! system.virtual_clock(); // without it, in real time
//! let executors = Executors {
//!     control: system.executor("control").build()?,
//!     mechanism: system.executor("mechanism").build()?,
//!     operator: system.executor("operator").build()?,
//! };
//! let settings = Settings {
//!     period: Duration::from_millis(10),
//!     cycles: 50,
//!     start: Start::Calibrated,
//!     joystick: Recording::built_in().play(),
//! };
//! let machine = hardware::simulated(&mut system, &executors.mechanism, settings.period)?;
//! let findings = network::build(&executors, machine.registers, settings)?;
//! # drop(executors);
//! system.run()?;
//! assert!(findings.iter().all(|axis| axis.tracking.get().unwrap().max() < 0.1));
//! assert!(machine.states.iter().all(|axis| axis.get().unwrap().speed.abs() < 0.5));
//! # Ok::<(), luna::Error>(())
//! ```

mod axes;
pub mod hardware;
pub mod joystick;
pub mod network;
pub mod parts;
mod processes;
mod verdict;

pub use axes::{AXES, Axis};
pub use network::{Executors, Findings, Settings, Start};
pub use verdict::verdict;
