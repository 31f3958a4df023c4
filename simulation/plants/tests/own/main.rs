//! What needs a process of its own: counted allocations.

mod allocation;
