//! Time as processes see it: the clock, delays, and periodic loops with their statistics.

mod after;
mod distribution;
mod periodic;
mod registry;
mod statistics;

pub use after::{After, after, at, now};
pub use distribution::Distribution;
pub use luna_platform::clock::Instant;
pub use periodic::{Cycle, Overrun, Periodic, periodic};
pub(crate) use registry::{LoopName, Scope};
pub use statistics::LoopReport;
