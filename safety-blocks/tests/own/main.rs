//! What needs a process of its own: counted allocations.

#[path = "../../../tests/counting/mod.rs"]
mod counting;
#[path = "../../../tests/shared/spawn.rs"]
mod spawn;

mod allocation;
