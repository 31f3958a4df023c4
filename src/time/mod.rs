//! Time as processes see it: the clock, timer channels, and periodic loops with their statistics.

mod accounting;
mod clock;
mod distribution;
mod grid;
mod late;
mod late_cycle;
pub(crate) mod manager;
mod periodic;
mod registry;
mod spin;
mod statistics;
mod ticks;
mod timer;

pub use accounting::UsageSince;
pub(crate) use accounting::{Accounting, short};
pub use clock::now;
pub use distribution::Distribution;
pub(crate) use late::Witness;
pub use late_cycle::{LateCause, LateCauseKind, LateCycle, RanInstead, StolenTime};
pub use luna_platform::clock::Instant;
pub use manager::{
    CallbackReport, Firing, TickReport, TimerCallback, TimerManager, Timers, TimersReport,
};
pub(crate) use manager::{MOST_CALLBACKS, Manager, ManagerThread};
pub use periodic::{Cycle, Overrun, Periodic, periodic};
pub(crate) use registry::{LoopName, Scope};
pub use statistics::LoopReport;
pub use ticks::{NextTick, Tick, Ticks, ticks};
pub use timer::{Expiry, Timer};
