//! The backend on the standard library alone: what every system but Linux gets.

pub(crate) mod alarm;
pub mod boost;
pub(crate) mod clock;
pub(crate) mod crash;
pub(crate) mod facts;
pub mod fence;
#[cfg(unix)]
pub(crate) mod file;
pub(crate) mod futex;
pub mod inside;
pub(crate) mod latency;
pub mod lock;
pub(crate) mod memory;
pub(crate) mod parent;
pub(crate) mod reactor;
pub(crate) mod signals;
pub(crate) mod socket;
pub(crate) mod steal;
pub(crate) mod thread;
pub(crate) mod usage;
