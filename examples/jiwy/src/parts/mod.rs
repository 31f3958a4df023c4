//! What the processes compute, without any process or channel in it.

pub mod calibration;
pub mod faults;
pub mod pid;
pub mod sanity;
pub mod set_point;
pub mod tracking;

#[cfg(test)]
mod tests;
