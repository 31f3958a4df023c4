//! Processes and the constructs that compose them.

pub(crate) mod composition;
pub(crate) mod failed_at;
pub(crate) mod named;
pub mod par;
pub(crate) mod process;
pub(crate) mod supervised;
pub(crate) mod tree;
