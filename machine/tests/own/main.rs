//! Tests that change their whole process: signal handlers, the cores that it may use.

#[cfg(all(target_os = "linux", not(luna_portable), not(loom)))]
#[path = "../../../tests/shared/mod.rs"]
#[macro_use]
mod shared;

mod deadline_on_few_cores;
mod signals;
