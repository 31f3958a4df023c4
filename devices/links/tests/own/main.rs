//! What needs a process of its own: counted allocations.

#[path = "../common/mod.rs"]
mod common;
#[path = "../../../../tests/counting/mod.rs"]
mod counting;

mod allocation;
