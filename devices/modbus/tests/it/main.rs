//! The client against the simulated server, over loopback.

#![cfg(target_os = "linux")]

mod common;
mod faults;
mod peer;
mod recorder;
mod traffic;
mod writes;
