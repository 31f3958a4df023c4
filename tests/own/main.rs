//! Tests that need a process of their own, or the machine to themselves: counted allocations,
//! real-time priorities on one core, crashes. Each test runs in a child process, one after another
//! ([`shared::own_process`]).

#[path = "../shared/mod.rs"]
#[macro_use]
mod shared;

#[path = "../common/mod.rs"]
mod common;
#[path = "../counting/mod.rs"]
mod counting;
#[path = "../kernel/mod.rs"]
mod kernel;
#[path = "../levels/mod.rs"]
mod levels;

mod allocation;
mod bands;
mod budgets;
mod call_priority;
mod crash_in_state;
mod deadline_loops;
mod emergency_functions;
mod emergency_injection;
mod emergency_on_a_core;
#[cfg(feature = "events")]
mod events_allocation;
mod hang_on_a_core;
mod inversion;
mod late_cycles;
mod lock_priority;
mod par_collections;
mod record_allocation;
mod same_core;
mod spin_before_sleep;
mod timer_channels;
mod timer_manager;

/// Counts for the tests of allocations, each of which runs alone in its process. Aborts where
/// [`crash_in_state`] wants it.
#[global_allocator]
static ALLOCATOR: counting::Counting = counting::Counting::calling(crash_in_state::abort_if_armed);
