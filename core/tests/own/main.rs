//! What needs a process of its own: counted allocations.

#[path = "../support/mod.rs"]
#[macro_use]
mod support;

#[path = "../support/files.rs"]
mod file_support;

mod files_allocate_nothing;
