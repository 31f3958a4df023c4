//! Tests that change their whole process: signal handlers, the cores that it may use.

#[path = "../../../tests/common/own_process.rs"]
#[macro_use]
mod own_process;

mod deadline_on_few_cores;
mod signals;
