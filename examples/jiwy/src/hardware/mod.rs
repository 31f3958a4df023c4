//! The processes' view of the machine: for each axis the registers of a card.
//!
//! A register is a buffer of one that overwrites: it is read and written without waiting, like that
//! of a real card. Set-up selects what is behind it: [`simulated`] processes on the system's own
//! clock, a [`Simulator`] outside of the system that drives its clock in [`lock_step`], or what the
//! caller links to the other sides of [`registers`], such as a card.

mod lock_step;
mod simulated;

pub use lock_step::{Axis, Simulator, lock_step};
pub(crate) use simulated::simulates;
pub use simulated::{Simulated, simulated};

use luna::prelude::*;

/// The registers of one axis, on the side of the processes that control it.
#[derive(Debug)]
pub struct Registers {
    /// What the encoder's counter reads: 32 bits that wrap.
    pub count: Receiver<i32>,
    /// The bridge's duty, −1 to 1.
    pub pwm: Sender<f64>,
    /// Whether the bridge is switched on.
    pub enable: Sender<bool>,
}

/// The registers of one axis, on the side of the hardware.
#[derive(Debug)]
pub struct Bench {
    /// What the encoder's counter reads.
    pub count: Sender<i32>,
    /// The bridge's duty.
    pub pwm: Receiver<f64>,
    /// Whether the bridge is switched on.
    pub enable: Receiver<bool>,
}

/// Both sides of one axis' registers. Its name is part of the names of their channels.
pub fn registers(axis: &str) -> (Registers, Bench) {
    let (count, counts) = luna::buffered(Buffer::overwrite_oldest(1));
    let (pwm, duties) = luna::buffered(Buffer::overwrite_oldest(1));
    let (enable, enables) = luna::buffered(Buffer::overwrite_oldest(1));
    let name = |register: &str| format!("{axis} {register} register");
    let count = count.named(&name("count"));
    let pwm = pwm.named(&name("pwm"));
    let enable = enable.named(&name("enable"));
    (
        Registers {
            count: counts,
            pwm,
            enable,
        },
        Bench {
            count,
            pwm: duties,
            enable: enables,
        },
    )
}
