//! Facts of a process in the kernel's files.

pub mod control_group;
pub mod task;
