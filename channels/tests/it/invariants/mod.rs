//! The invariants of the communication protocol, each with tests that bear its name.

#![cfg(not(loom))]

use crate::common;
mod exact;
mod memory;
mod offers;
#[cfg(not(luna_one_cpu))]
mod outcomes;

use luna_channels::{Receiver, RecvError, pri_alt};

/// Waits for either channel; gives what it received, and from which.
async fn either<T>(first: &Receiver<T>, second: &Receiver<T>) -> (u8, Result<T, RecvError>) {
    pri_alt! {
        value = first.recv() => (1, value),
        value = second.recv() => (2, value),
    }
}
