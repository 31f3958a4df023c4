//! What happens when something goes wrong: the emergency functions, run once, before anything else; and watchdogs, which find it out.

mod emergency;
mod watchdog;

pub(crate) use emergency::{Emergency, EmergencyThread, Function};
pub use watchdog::{Bite, Watchdog, WatchdogProcess};
