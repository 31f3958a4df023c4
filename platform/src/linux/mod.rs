//! The complete backend: Linux, through `nix` where it has the call and `libc` where it has not.

pub(crate) mod alarm;
mod alternate_stack;
pub mod boost;
pub(crate) mod clock;
pub(crate) mod crash;
mod deadline;
pub(crate) mod facts;
pub mod fence;
pub(crate) mod file;
pub(crate) mod futex;
pub mod inside;
pub(crate) mod latency;
pub mod lock;
pub(crate) mod memory;
pub(crate) mod parent;
pub(crate) mod privileges;
pub(crate) mod reactor;
pub(crate) mod signals;
pub(crate) mod socket;
pub(crate) mod steal;
pub(crate) mod thread;
pub(crate) mod usage;
