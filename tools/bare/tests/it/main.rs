//! The kernel without an operating system, on a simulated CPU. The channels' own tests run here too:
//! those that need no threads.

#[path = "../../../../channels/tests/common/mod.rs"]
mod common;

// Tests of channels, as they are.
#[path = "../../../../channels/tests/it/buffered.rs"]
mod buffered;
#[path = "../../../../channels/tests/it/rendezvous.rs"]
mod rendezvous;
#[path = "../../../../channels/tests/it/stream.rs"]
mod stream;

mod contexts;
mod interrupts;
#[cfg(target_os = "linux")]
mod preemption;
mod processes;
