//! The processes of Jiwy: what each of them does between the channels that `network` gives it.

use super::network::Findings;
use super::pid::Pid;
use super::sanity::SanityCheck;
use super::set_point::SetPoint;
use super::tracking::Tracking;
use super::{AXES, Axis};
use crate::joystick::Playback;
use luna::prelude::*;
use luna::{Instant, TryRecvError};
use luna_plants::{Decoder, Encoder, Motor};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The joystick is sampled as often as it was recorded.
const JOYSTICK_PERIOD: Duration = Duration::from_millis(10);

/// What a controller asks of a motor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Command {
    /// Its place in [`AXES`].
    axis: usize,
    /// −1 to 1, if the controller is in order.
    duty: f64,
    /// As measured, in rad.
    angle: f64,
    /// Since the command before, in s.
    elapsed: f64,
}

/// One axis' controller: a cycle in each period.
pub(super) struct Controller {
    pub(super) axis: usize,
    pub(super) period: Duration,
    pub(super) cycles: u64,
    pub(super) set_point: SetPoint,
    pub(super) pid: Pid,
    pub(super) tracking: Tracking,
    pub(super) set_points: Receiver<f64>,
    pub(super) request: Sender<()>,
    pub(super) angles: Receiver<f64>,
    pub(super) commands: Sender<Command>,
    pub(super) findings: Arc<Findings>,
}

impl Process for Controller {
    async fn run(&mut self) -> luna::Result<()> {
        let mut tick = luna::periodic(AXES[self.axis].name, self.period)?;
        let mut slots = Slots::new(self.period);
        let mut deflection = 0.0;
        for _ in 0..self.cycles {
            // Slots are what counts, not when the process woke up; a missed one is part of the elapsed time.
            let elapsed = slots.elapsed(tick.next().await.deadline);
            if let Ok(moved) = self.set_points.try_recv() {
                deflection = moved;
            }
            let target = self.set_point.follow(deflection, elapsed);
            // Asks, so that the count is from now and not from when the last one was taken.
            self.request.send(()).await?;
            let angle = self.angles.recv().await?;
            self.tracking.add(target - angle);
            let duty = self.pid.update(target, angle, elapsed);
            self.commands
                .send(Command {
                    axis: self.axis,
                    duty,
                    angle,
                    elapsed,
                })
                .await?;
        }
        Ok(())
    }

    fn post_run(&mut self) {
        let _ = self.findings.tracking.set(self.tracking);
    }
}

/// The safety layer: what reaches the motors passes here.
pub(super) struct Sanity {
    pub(super) checks: [SanityCheck; 2],
    pub(super) commands: Receiver<Command>,
    pub(super) duties: [Sender<f64>; 2],
    pub(super) findings: [Arc<Findings>; 2],
}

impl Process for Sanity {
    async fn run(&mut self) -> luna::Result<()> {
        while let Ok(command) = self.commands.recv().await {
            let duty =
                self.checks[command.axis].check(command.duty, command.angle, command.elapsed);
            self.duties[command.axis].send(duty).await?;
        }
        Ok(())
    }

    fn post_run(&mut self) {
        for (check, findings) in self.checks.iter().zip(&self.findings) {
            let _ = findings.interventions.set(check.interventions());
        }
    }
}

/// The hardware of one axis: bridge, motor, joint, encoder and counter, in its own time.
pub(super) struct Mechanism {
    pub(super) name: String,
    pub(super) period: Duration,
    pub(super) plant: Motor,
    pub(super) encoder: Encoder,
    pub(super) enabled: Arc<AtomicBool>,
    pub(super) bridge: Receiver<f64>,
    pub(super) count: Sender<i32>,
    pub(super) findings: Arc<Findings>,
}

impl Process for Mechanism {
    async fn run(&mut self) -> luna::Result<()> {
        let mut tick = luna::periodic(&self.name, self.period)?;
        let mut slots = Slots::new(self.period);
        let mut duty = 0.0;
        loop {
            let elapsed = slots.elapsed(tick.next().await.deadline);
            // First what was applied until now, then what was written meanwhile.
            let applied = if self.enabled.load(Ordering::Relaxed) {
                duty
            } else {
                0.0
            };
            self.plant.drive(applied, elapsed);
            match self.bridge.try_recv() {
                Ok(written) => duty = written,
                Err(TryRecvError::Empty) => {}
                Err(_) => return Ok(()),
            }
            // Who reads the counter may have ended before the motor is off: that is no matter of the hardware.
            let _ = self
                .count
                .send(self.encoder.count(self.plant.state().angle))
                .await;
        }
    }

    fn post_run(&mut self) {
        let _ = self.findings.state.set(self.plant.state());
    }
}

/// Answers each request with the angle by the newest count.
pub(super) async fn read_encoder(
    axis: &'static Axis,
    counts: Receiver<i32>,
    requests: Receiver<()>,
    angle: Sender<f64>,
) -> luna::Result<()> {
    let mut decoder = Decoder::new(axis.plant.gear_ratio, axis.count_at_zero);
    let mut count = axis.count_at_zero;
    while requests.recv().await.is_ok() {
        if let Ok(newer) = counts.try_recv() {
            count = newer;
        }
        angle.send(decoder.angle(count)).await?;
    }
    Ok(())
}

/// Writes each duty to the bridge, and 0 at the end.
pub(super) async fn write_motor(duties: Receiver<f64>, pwm: Sender<f64>) -> luna::Result<()> {
    while let Ok(duty) = duties.recv().await {
        pwm.send(duty).await?;
    }
    pwm.send(0.0).await?;
    Ok(())
}

/// Plays the recording to both controllers until they have ended.
///
/// A type and not an async function, since those drop what they hold when they return, still on the real-time path: the recording is memory.
pub(super) struct Joystick {
    pub(super) playback: Playback,
    pub(super) sticks: [Sender<f64>; 2],
}

impl Process for Joystick {
    async fn run(&mut self) -> luna::Result<()> {
        let mut tick = luna::periodic("joystick", JOYSTICK_PERIOD)?;
        let mut slots = Slots::new(Duration::ZERO);
        let mut time = 0.0;
        loop {
            time += slots.elapsed(tick.next().await.deadline);
            let deflection = self.playback.at(time);
            for (axis, stick) in AXES.iter().zip(&self.sticks) {
                if stick.send((axis.stick)(deflection)).await.is_err() {
                    return Ok(());
                }
            }
        }
    }
}

/// The time between the slots of a loop.
struct Slots {
    last: Option<Instant>,
    first: Duration,
}

impl Slots {
    /// The first slot counts as `first` after one that was not.
    fn new(first: Duration) -> Self {
        Self { last: None, first }
    }

    /// Seconds from the slot before to the one at `deadline`.
    fn elapsed(&mut self, deadline: Instant) -> f64 {
        self.last
            .replace(deadline)
            .map_or(self.first, |last| deadline - last)
            .as_secs_f64()
    }
}
