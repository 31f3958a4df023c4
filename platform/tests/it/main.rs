//! Tests of the system-call layer. One program; a module a subject.

mod pi_lock;
mod reactor;
mod thread;
