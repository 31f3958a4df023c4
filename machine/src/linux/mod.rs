//! The complete backend: Linux, through `nix` where it has the call and `libc` where it has not.

pub(crate) mod alarm;
pub(crate) mod crash;
pub(crate) mod facts;
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
