//! The backend on the standard library alone: what every system but Linux gets.

pub mod boost;
pub(crate) mod clock;
pub mod fence;
pub(crate) mod futex;
pub mod inside;
pub mod lock;
pub(crate) mod reactor;
pub(crate) mod thread;
