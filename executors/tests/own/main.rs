//! What needs a process of its own: counted allocations.

#[path = "../support/files.rs"]
mod file_support;
#[path = "../support/mod.rs"]
mod support;

mod files_allocate_nothing;
