//! Controllers over the simulated bus, and over an interface of the kernel where it has one.

mod bus;
mod canopen;
mod common;
mod controller;
#[cfg(all(feature = "socketcan", target_os = "linux"))]
mod socket;
