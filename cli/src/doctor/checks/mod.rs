//! What is looked at in the machine's files. One file a subject, each with its list; a new finding
//! is one entry there.

mod board;
mod clock;
mod cores;
mod interrupts;
mod kernel;
mod memory;
mod permissions;
mod power;
mod throttling;
mod virtual_machine;
mod watchdogs;

pub(crate) use virtual_machine::steal_seen;

use super::facts::number;
use super::finding::{Check, Seen};
use super::machine::{Machine, missing_is};
use luna_machine::facts::Unread;

/// All of them, in the order in which they are shown.
pub(crate) fn all() -> impl Iterator<Item = &'static Check> {
    [
        board::CHECKS,
        kernel::CHECKS,
        permissions::CHECKS,
        throttling::CHECKS,
        cores::CHECKS,
        interrupts::CHECKS,
        power::CHECKS,
        clock::CHECKS,
        memory::CHECKS,
        virtual_machine::CHECKS,
        watchdogs::CHECKS,
    ]
    .into_iter()
    .flatten()
}

/// Judges a kernel switch that is better off. A kernel without it counts as off.
fn better_off(machine: &Machine, from: &str, advice: &str) -> Result<Seen, Unread> {
    Ok(match missing_is(machine.source.parse(from, number), 0)? {
        0 => Seen::good("off", from),
        _ => Seen::better("on", from, advice),
    })
}
