//! The backend on the standard library alone: what every system but Linux gets.

pub(crate) mod alarm;
pub(crate) mod crash;
pub(crate) mod facts;
#[cfg(unix)]
pub(crate) mod file;
pub(crate) mod latency;
pub(crate) mod memory;
pub(crate) mod parent;
pub(crate) mod signals;
pub(crate) mod socket;
pub(crate) mod steal;
pub(crate) mod tai;
pub(crate) mod threads;
pub(crate) mod usage;
