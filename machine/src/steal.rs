//! The time that a hypervisor has taken from the cores of a virtual machine.

pub use crate::backend::steal::StealMeter;
