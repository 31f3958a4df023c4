//! The machine outside of the system, in lock-step with it: the processes' time advances only as
//! far as the machine has been computed.

use super::{Bench, Registers, registers};
use crate::AXES;
use luna::System;
use luna::system::{ClockDriver, DriveError};
use luna_plants::{Encoder, Motor, MotorState};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How many steps the machine continues after the system's end, so that the current of a motor that
/// was switched off decays.
const STEPS_AFTER_THE_END: u32 = 50;

/// A simulator of the machine, which drives the system's clock. Run it on a thread beside the one
/// that runs the system.
#[derive(Debug)]
pub struct Simulator {
    driver: ClockDriver,
    axes: [Axis; 2],
    /// The bridges' enable line.
    line: Arc<AtomicBool>,
}

/// One axis of the machine. What a test breaks is public.
#[derive(Debug)]
pub struct Axis {
    /// The motor and what it turns.
    pub motor: Motor,
    /// Whether the encoder counts.
    pub counts: bool,
    encoder: Encoder,
    bench: Bench,
    duty: f64,
    enabled: bool,
}

/// Puts `system` on a driven clock. Returns the registers for its processes, and the simulator. An
/// emergency disables the bridges.
pub fn lock_step(system: &mut System) -> ([Registers; 2], Simulator) {
    let driver = system.driven_clock();
    let line = Arc::new(AtomicBool::new(true));
    let pulled = Arc::clone(&line);
    system.on_emergency("motors off", move || pulled.store(false, Ordering::Relaxed));
    let axis = |index: usize| {
        let axis = &AXES[index];
        let (registers, bench) = registers(axis.name);
        let encoder = Encoder::new(axis.plant.gear_ratio, axis.count_at_zero);
        let simulated = Axis {
            motor: Motor::new(axis.plant),
            counts: true,
            encoder,
            bench,
            duty: 0.0,
            enabled: false,
        };
        (registers, simulated)
    };
    let ((pan, pan_axis), (tilt, tilt_axis)) = (axis(0), axis(1));
    let simulator = Simulator {
        driver,
        axes: [pan_axis, tilt_axis],
        line,
    };
    ([pan, tilt], simulator)
}

impl Simulator {
    /// Takes steps of `step` until the system has ended and the motors are off. Calls `before`
    /// before each step of the system, with its number from 0 on. Returns the final state of the
    /// joints.
    ///
    /// In each step the machine moves under the values written in earlier steps, its counters are
    /// written to the registers, and then the processes run up to that time.
    pub fn run(
        mut self,
        step: Duration,
        mut before: impl FnMut(u64, &mut [Axis; 2]),
    ) -> [MotorState; 2] {
        for number in 0.. {
            before(number, &mut self.axes);
            self.step(step);
            if let Err(DriveError::Ended { .. }) = self.driver.advance_by(step) {
                break;
            }
        }
        for _ in 0..STEPS_AFTER_THE_END {
            self.step(step);
        }
        self.axes.map(|axis| axis.motor.state())
    }

    fn step(&mut self, step: Duration) {
        let line = self.line.load(Ordering::Relaxed);
        for axis in &mut self.axes {
            axis.step(step, line);
        }
    }
}

impl Axis {
    fn step(&mut self, step: Duration, line: bool) {
        if let Ok(written) = self.bench.enable.try_recv() {
            self.enabled = written;
        }
        if let Ok(written) = self.bench.pwm.try_recv() {
            self.duty = written;
        }
        let duty = if self.enabled && line { self.duty } else { 0.0 };
        self.motor.drive(duty, step.as_secs_f64());
        if self.counts {
            // The counter's reader may have ended, which does not concern the machine.
            let _ = self
                .bench
                .count
                .try_send(self.encoder.count(self.motor.state().angle));
        }
    }
}
