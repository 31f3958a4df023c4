//! Jiwy as communicating sequential processes, after the thesis' figure A.2.
//!
//! ```text
//!  operator        control (the measured executor)                                      mechanism
//!
//!             ~~> pan ──()──> pan encoder reader <~~~~~~~~~~~~~~ counts ~~~~~~~~~~~~~~~ pan mechanism
//!             |    │  <─angle─╯                                                             ^
//!             |    ╰─command─╮                                                              |
//!  joystick ~~|              ├──> sanity check ──duty──> pan motor writer ~~~~~~ PWM ~~~~~~~~
//!             |    ╭─command─╯          ╰───────duty──> tilt motor writer ~~~~~~ PWM ~~~~~~~~
//!             |    │                                                                        v
//!             ~~> tilt ─()──> tilt encoder reader <~~~~~~~~~~~~~ counts ~~~~~~~~~~~~~~~ tilt mechanism
//!
//!  ──> rendezvous channel      ~~> buffer of one that forgets the older value: a register, never waited for
//! ```
//!
//! Periodic: `pan`, `tilt` and the two mechanisms at the demo's rate, `joystick` at its recording's 100 Hz. All others are woken by
//! what they receive, and have higher levels than who sends it, so that a cycle goes from the encoder to the motor in one go.
//!
//! **No deadlock.** Rendezvous go one way, from controller to reader and from controller over the sanity check to a writer; only the reader
//! answers, to a client that waits for nothing else. A circle of waiting would have to pass a register, where nobody waits. The two
//! controllers share one channel to the sanity check, so neither has to wait for the other's sample, also when one skips a slot.
//!
//! **The end.** A controller returns after its number of cycles and drops its ends. The reader sees its requests closed; the sanity
//! check its commands, once both controllers have gone; the writers their duties, whereupon they write a last PWM of 0; the mechanisms
//! their PWM; the joystick its set-points. The same follows if any of them fails.
//!
//! **No allocation.** Values are `Copy`, state lies in the processes, results are handed over in `post_run`.

use super::AXES;
use super::pid::{Gains, Pid};
use super::processes::{Controller, Joystick, Mechanism, Sanity, read_encoder, write_motor};
use super::sanity::{Interventions, SanityCheck};
use super::set_point::SetPoint;
use super::tracking::Tracking;
use crate::joystick::Playback;
use luna::Executor;
use luna::prelude::*;
use luna_plants::{Encoder, Motor, MotorState};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// Levels on the control executor: later in a cycle is higher.
mod level {
    pub(super) const PAN: u8 = 11;
    pub(super) const TILT: u8 = 10;
    pub(super) const ENCODER_READER: u8 = 15;
    pub(super) const SANITY_CHECK: u8 = 20;
    pub(super) const MOTOR_WRITER: u8 = 25;
}

/// What the processes of one axis leave behind when they end.
#[derive(Debug, Default)]
pub(crate) struct Findings {
    /// The controller's.
    pub(crate) tracking: OnceLock<Tracking>,
    /// The safety layer's.
    pub(crate) interventions: OnceLock<Interventions>,
    /// The mechanism's, after the motor was switched off.
    pub(crate) state: OnceLock<MotorState>,
}

/// Where the processes run.
#[derive(Debug)]
pub(crate) struct Executors {
    /// The controllers, the safety layer, readers and writers.
    pub(crate) control: Executor,
    /// The simulated hardware.
    pub(crate) mechanism: Executor,
    /// The joystick.
    pub(crate) operator: Executor,
}

/// Adds all processes to `system`: controllers that run `cycles` cycles of `period`. The findings are those of pan and of tilt.
pub(crate) fn build(
    system: &mut System,
    executors: &Executors,
    period: Duration,
    cycles: u64,
    joystick: Playback,
) -> luna::Result<[Arc<Findings>; 2]> {
    let Executors {
        control,
        mechanism,
        operator,
    } = executors;
    let findings: [Arc<Findings>; 2] = Default::default();
    let (commands, checked) = luna::channel();

    // The bridges' enable line, which an emergency pulls.
    let enabled = Arc::new(AtomicBool::new(true));
    let line = Arc::clone(&enabled);
    system.on_emergency("motors off", move || line.store(false, Ordering::Relaxed));

    let add_axis = |index: usize, level: u8| -> luna::Result<(Sender<f64>, Sender<f64>)> {
        let axis = &AXES[index];
        let name = |part: &str| format!("{} {part}", axis.name);
        let (count, counts) = luna::buffered(Buffer::overwrite_oldest(1));
        let (pwm, bridge) = luna::buffered(Buffer::overwrite_oldest(1));
        let (stick, set_points) = luna::buffered(Buffer::overwrite_oldest(1));
        let (request, requests) = luna::channel();
        let (angle, angles) = luna::channel();
        let (duty, duties) = luna::channel();

        mechanism
            .process(&name("mechanism"))
            .priority(level)
            .spawn(Mechanism {
                name: name("mechanism"),
                period,
                plant: Motor::new(axis.plant),
                encoder: Encoder::new(axis.plant.gear_ratio, axis.count_at_zero),
                enabled: Arc::clone(&enabled),
                bridge,
                count,
                findings: Arc::clone(&findings[index]),
            })?;
        control
            .process(&name("encoder reader"))
            .priority(level::ENCODER_READER)
            .spawn(read_encoder(axis, counts, requests, angle))?;
        control
            .process(axis.name)
            .priority(level)
            .spawn(Controller {
                axis: index,
                period,
                cycles,
                set_point: SetPoint::new(axis.range, axis.max_speed),
                pid: Pid::new(Gains::place(&axis.plant, axis.tuning, period.as_secs_f64())),
                tracking: Tracking::default(),
                set_points,
                request,
                angles,
                commands: commands.clone(),
                findings: Arc::clone(&findings[index]),
            })?;
        control
            .process(&name("motor writer"))
            .priority(level::MOTOR_WRITER)
            .spawn(write_motor(duties, pwm))?;
        Ok((stick, duty))
    };
    let (pan_stick, pan_duty) = add_axis(0, level::PAN)?;
    let (tilt_stick, tilt_duty) = add_axis(1, level::TILT)?;
    // The last sender must be a controller's.
    drop(commands);

    control
        .process("sanity check")
        .priority(level::SANITY_CHECK)
        .spawn(Sanity {
            checks: [0, 1].map(|axis| SanityCheck::new(AXES[axis].limits)),
            commands: checked,
            duties: [pan_duty, tilt_duty],
            findings: findings.clone(),
        })?;
    operator.process("joystick").spawn(Joystick {
        playback: joystick,
        sticks: [pan_stick, tilt_stick],
    })?;
    Ok(findings)
}
