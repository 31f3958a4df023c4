//! The machine behind a Mesa Anything I/O card: PWM generators 0 and 1 drive pan and tilt, encoders
//! 0 and 1 count.

use luna::prelude::*;
use luna::{Error, Executor};
use luna_jiwy::AXES;
use luna_jiwy::hardware::{Bench, Registers, registers};
use luna_mesa::{Bucket, Health, OpenError, Reading, Sample};
use std::net::ToSocketAddrs;
use std::sync::Arc;
use std::time::Duration;

/// The time of the card's watchdog, in periods: without the program the machine is off after it.
const WATCHDOG: u32 = 50;

/// The link fails after this many cycles in a row without an answer (or after losing more than one
/// in 11 for long). Until then the controllers use the last position, which is off by a few degrees
/// at most.
const TOLERANCE: Bucket = Bucket::new(10, 1, 201);

/// The machine, for the set-up of the system.
#[derive(Debug)]
pub(crate) struct Behind {
    /// Of pan and of tilt.
    pub(crate) registers: [Registers; 2],
    /// What the link counts.
    pub(crate) health: Arc<Health>,
}

/// Opens the card at `address` as a device of the system, and adds its link, which exchanges
/// packets each `period`. An emergency disables the card's outputs.
///
/// Only fresh positions are written to the registers. They count from the machine's present
/// position; [`Start::Calibrated`](luna_jiwy::Start::Calibrated) needs the middle position.
///
/// # Errors
///
/// An [`OpenError`] in [`Error::Other`], the card lacks a unit, or those of
/// [`spawn`](luna::system::ProcessBuilder::spawn).
pub(crate) fn mesa(
    system: &System,
    executor: &Executor,
    address: impl ToSocketAddrs,
    period: Duration,
) -> luna::Result<Behind> {
    let card = luna_mesa::open(&system.devices(), address)
        .map_err(|error: OpenError| Error::other(error))?;
    let mut link = card.link("card", period);
    link.watchdog(period * WATCHDOG).tolerance(TOLERANCE);
    let mut build_axis = |index: usize| {
        let axis = &AXES[index];
        let (registers, Bench { count, pwm, enable }) = registers(axis.name);
        let (reading, readings) = luna::buffered(Buffer::overwrite_oldest(1));
        let number = index as u8;
        let reading = reading.named(&format!("{} count reading", axis.name));
        link.encoder(number, fastest(index), reading)
            .pwm_with_enable(number, pwm, enable);
        executor
            .process(format!("{} counts", axis.name))
            .spawn(report_counts(axis.count_at_zero, period, readings, count))?;
        Ok::<_, Error>(registers)
    };
    let registers = [build_axis(0)?, build_axis(1)?];
    let process = link.process().map_err(Error::other)?;
    let health = process.health();
    executor.process("card").spawn(process)?;
    Ok(Behind { registers, health })
}

/// The motor's greatest speed without load in counts a second, and half as much again.
fn fastest(index: usize) -> f64 {
    let motor = &AXES[index].plant;
    let turns = motor.supply / motor.torque_constant / std::f64::consts::TAU;
    1.5 * turns * luna_plants::COUNTS_PER_MOTOR_TURN
}

/// Writes the encoder's counts to the register while they are fresh. A register has no age, so a
/// value that has waited for longer than a period (since this executor was delayed) is not written.
async fn report_counts(
    at_zero: i32,
    period: Duration,
    readings: Receiver<Sample<Reading>>,
    register: Sender<i32>,
) -> luna::Result<()> {
    while let Ok(sample) = readings.recv().await {
        let [asked, _] = sample.measured_between();
        if let Some(reading) = sample.fresh()
            && luna::now() - asked <= period
        {
            // The low 32 bits are what a counter keeps.
            let count = at_zero.wrapping_add(reading.position as i32);
            if register.send(count).await.is_err() {
                break;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
