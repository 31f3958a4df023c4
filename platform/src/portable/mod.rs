//! The backend on the standard library alone: what every system but Linux gets.

pub(crate) mod clock;
pub mod futex;
pub mod lock;
