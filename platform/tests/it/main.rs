//! Tests of the system-call layer. One program; a module a subject.

#[path = "../../../tests/shared/mod.rs"]
#[macro_use]
mod shared;

mod deadline;
mod memory_and_latency;
mod pi_lock;
mod reactor;
mod thread;
