//! The Production Cell of the thesis (appendix A.2): six units in a circle, and blocks that go
//! round.
//!
//! ```text
//!      ╭──> feeder belt ──> feeder ──> moulder door ──╮
//!      ╰─── robot <── extraction belt <── extractor <─╯
//! ```
//!
//! [`unit::build`] makes a unit, the same way for all six and for every deployment. [`deploy`] has
//! the deployments: on one executor, on six threads, in six programs. They differ in where a unit's
//! processes run, and in its [`links`]. [`command`] has the state machines, [`laws`] the control
//! laws, [`safety`] the rules of the safety blocks, [`mechanics`] the simulated machine,
//! [`parameters`] all figures. `examples/production-cell/README.md` is the page about it.

#![cfg(target_os = "linux")]

pub mod command;
pub mod deploy;
pub mod laws;
pub mod links;
pub mod mechanics;
pub mod messages;
pub mod operator;
mod outcome;
pub mod parameters;
pub mod picture;
pub mod safety;
mod simulation;
pub mod unit;

pub use deploy::Settings;
pub use operator::{Breakage, Drill, Plan};
pub use outcome::{Outcome, UnitOutcome};
pub use parameters::Unit;
