//! The machine as processes: for each axis the bridge, the joint with its motor, and the encoder's
//! counter.

use super::{Bench, Registers, registers};
use crate::AXES;
use luna_plants::{Encoder, Motor, MotorState};

use luna::prelude::*;
use luna::replay;
use luna::{Executor, TryRecvError};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// A bridge without a new value for this time, in seconds, switches its motor off, as a card's
/// watchdog does.
const WATCHDOG: f64 = 0.1;

/// What the processes of an axis are called, behind its name.
const BRIDGE: &str = "bridge";
const JOINT: &str = "joint";
const COUNTER: &str = "counter";

/// Whether the process called `name` is one of the machine's.
pub(crate) fn simulates(name: &str) -> bool {
    let part = name.rsplit_once(' ').map(|(_, part)| part);
    part.is_some_and(|part| [BRIDGE, JOINT, COUNTER].contains(&part))
}

/// What a motor is given, for how long.
#[derive(Debug, Clone, Copy)]
struct Applied {
    duty: f64,
    time: f64,
}

/// The simulated machine, for the set-up of the system.
#[derive(Debug)]
pub struct Simulated {
    /// Of pan and of tilt.
    pub registers: [Registers; 2],
    /// Where each joint will have been when its motor was off.
    pub states: [Arc<OnceLock<MotorState>>; 2],
}

/// Adds the machine's processes, which take a step in each `period`. An emergency disables the
/// bridges.
///
/// # Errors
///
/// Those of [`spawn`](luna::system::ProcessBuilder::spawn).
pub fn simulated(
    system: &mut System,
    executor: &Executor,
    period: Duration,
) -> luna::Result<Simulated> {
    let line = Arc::new(AtomicBool::new(true));
    let pulled = Arc::clone(&line);
    system.on_emergency("motors off", move || pulled.store(false, Ordering::Relaxed));
    let states: [Arc<OnceLock<MotorState>>; 2] = Default::default();
    let build_axis = |index: usize| {
        let axis = &AXES[index];
        let name = |part: &str| format!("{} {part}", axis.name);
        let (registers, Bench { count, pwm, enable }) = registers(axis.name);
        let (apply, applied) = luna::channel();
        let (angle, angles) = luna::channel();
        let apply = apply.named(&name("bridge voltage"));
        let angle = angle.named(&name("joint angle"));
        executor.process(name(BRIDGE)).spawn(Bridge {
            name: name(BRIDGE),
            period,
            line: Arc::clone(&line),
            pwm,
            enable,
            apply,
        })?;
        executor.process(name(JOINT)).spawn(Joint {
            plant: Motor::new(axis.plant),
            applied,
            angle,
            state: Arc::clone(&states[index]),
        })?;
        let encoder = Encoder::new(axis.plant.gear_ratio, axis.count_at_zero);
        executor
            .process(name(COUNTER))
            .spawn(count_edges(encoder, angles, count))?;
        Ok::<_, luna::Error>(registers)
    };
    Ok(Simulated {
        registers: [build_axis(0)?, build_axis(1)?],
        states,
    })
}

/// Applies the written duty to the motor, in simulated time of one period a cycle. The simulated
/// world stands still while its thread is delayed. Otherwise it would jump, which a real machine
/// does not, and which safety would take for a broken encoder.
struct Bridge {
    name: String,
    period: Duration,
    line: Arc<AtomicBool>,
    pwm: Receiver<f64>,
    enable: Receiver<bool>,
    apply: Sender<Applied>,
}

impl Process for Bridge {
    async fn run(&mut self) -> luna::Result<()> {
        let mut tick = luna::periodic(&self.name, self.period)?;
        let time = self.period.as_secs_f64();
        let (mut duty, mut enabled, mut unwritten) = (0.0, false, 0.0);
        loop {
            tick.next().await;
            let line = replay::input("enable line", || self.line.load(Ordering::Relaxed));
            let on = enabled && unwritten < WATCHDOG && line;
            // First what was applied until now, then what was written meanwhile.
            let applied = Applied {
                duty: if on { duty } else { 0.0 },
                time,
            };
            self.apply.send(applied).await?;
            if let Ok(written) = self.enable.try_recv() {
                enabled = written;
            }
            match self.pwm.try_recv() {
                Ok(written) => (duty, unwritten) = (written, 0.0),
                Err(TryRecvError::Empty) => unwritten += time,
                Err(_) => return Ok(()),
            }
        }
    }
}

/// The motor and what it turns.
struct Joint {
    plant: Motor,
    applied: Receiver<Applied>,
    angle: Sender<f64>,
    state: Arc<OnceLock<MotorState>>,
}

impl Process for Joint {
    async fn run(&mut self) -> luna::Result<()> {
        while let Ok(Applied { duty, time }) = self.applied.recv().await {
            self.plant.drive(duty, time);
            let angle = self.plant.state().angle;
            replay::output("angle", &angle);
            self.angle.send(angle).await?;
        }
        Ok(())
    }

    fn post_run(&mut self) {
        let _ = self.state.set(self.plant.state());
    }
}

/// Counts the edges that pass.
async fn count_edges(
    encoder: Encoder,
    angles: Receiver<f64>,
    count: Sender<i32>,
) -> luna::Result<()> {
    while let Ok(angle) = angles.recv().await {
        // The counter's reader may have ended before the motor is off, which does not concern the
        // hardware.
        let _ = count.send(encoder.count(angle)).await;
    }
    Ok(())
}
