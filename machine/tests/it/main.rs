//! Tests of what a system holds of its machine. One program; a module a subject.

#[path = "../../../tests/shared/mod.rs"]
#[macro_use]
mod shared;

mod deadline;
mod memory_and_latency;
