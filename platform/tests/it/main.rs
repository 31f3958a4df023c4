//! Tests of the system-call layer. One program; a module a subject.

#[path = "../../../tests/shared/mod.rs"]
#[macro_use]
mod shared;

mod pi_lock;
mod reactor;
mod thread;
