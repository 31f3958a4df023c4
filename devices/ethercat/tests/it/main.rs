//! Tests of the driver against simulated subdevices. One program; a module a subject.

#[path = "../common/mod.rs"]
mod common;

mod clock;
mod data;
mod discovery;
mod faults;
mod interface;
mod order;
mod safety;
mod sdo;
mod start;
