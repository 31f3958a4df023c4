//! Processes and the constructs that compose them.

pub mod par;
pub(crate) mod process;
