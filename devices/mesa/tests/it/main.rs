//! Tests of the driver against the simulated card. One program; a module a subject.

#[path = "../common/mod.rs"]
mod common;

mod devices;
mod faults;
mod wiring;
