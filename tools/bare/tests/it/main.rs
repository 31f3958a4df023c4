//! The kernel without an operating system, on a simulated CPU. The channels' own tests run here
//! too: those that need no threads.

#[path = "../../../../channels/tests/common/mod.rs"]
mod common;

// Tests of channels, as they are.
#[path = "../../../../channels/tests/it/buffered.rs"]
mod buffered;
#[path = "../../../../channels/tests/it/cancel.rs"]
mod cancel;
#[path = "../../../../channels/tests/it/close.rs"]
mod close;
#[path = "../../../../channels/tests/it/ended.rs"]
mod ended;
#[path = "../../../../channels/tests/it/fairness.rs"]
mod fairness;
#[path = "../../../../channels/tests/it/given_back.rs"]
mod given_back;
#[path = "../../../../channels/tests/it/invariants/mod.rs"]
mod invariants;
#[path = "../../../../channels/tests/it/output_guards.rs"]
mod output_guards;
#[path = "../../../../channels/tests/it/poison.rs"]
mod poison;
#[path = "../../../../channels/tests/it/rendezvous.rs"]
mod rendezvous;
#[path = "../../../../channels/tests/it/sequential_model/mod.rs"]
mod sequential_model;
#[path = "../../../../channels/tests/it/stream.rs"]
mod stream;

mod allocation;
mod contexts;
mod interrupts;
#[cfg(target_os = "linux")]
mod preemption;
mod processes;
mod sync;
