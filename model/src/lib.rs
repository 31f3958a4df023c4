//! Models.

mod compile;
mod deployment;
mod elaborate;
mod explore;
mod file;
mod language;
mod model;
mod network;
mod properties;
mod spin;
mod text;

pub use explore::{DEFAULT_MAX_STATES, Exploration, Finding, FindingKind, Unreached};
pub use model::Model;
pub use spin::SpinCheck;
pub use spin::run::SpinError;
pub use text::Problem;
