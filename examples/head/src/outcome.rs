//! What became of a run, judged by what the simulated machine has truly done.

use crate::kinematics::Pose;
use crate::mechanics::{Fault, Trouble};
use crate::messages::Drive;
use crate::parameters::{
    AXES, DUTY_LIMIT, GAZE_BOUND, HEAD, HELD_DRIFT, HOLD_AFTER, SETTLE, STOP_WITHIN,
};
use luna_plants::MotorState;
use nalgebra::Vector3;
use serde::Serialize;

/// After images have stopped, the motors need this long, in s, to come to rest.
const REST: f64 = 0.4;

/// What became of a run. Angles in degrees, times in s.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Findings {
    /// How long the head was watched.
    pub seconds: f64,
    /// The gaze error, of the eye that is further off, while it is to be settled: its root mean
    /// square, and the largest. Absent if the run was too short.
    pub gaze_rms: Option<f64>,
    /// The largest.
    pub gaze_worst: Option<f64>,
    /// The most that an axis moved while no image came and the gaze was held, in degrees.
    pub held_drift: Option<f64>,
    /// When safety has stopped the head.
    pub stopped_at: Option<f64>,
    /// How long after the sensor's fault that was.
    pub stopped_after: Option<f64>,
    /// The largest duty of a motor.
    pub duty: f64,
    /// The duties that safety has changed.
    pub changed: u64,
    /// The axes.
    pub axes: Vec<AxisFindings>,
    /// What went wrong, if anything did, as it is named on the command line.
    pub faults: Vec<String>,
}

/// What became of an axis. Angles in degrees.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AxisFindings {
    /// Which.
    pub name: &'static str,
    /// The furthest that it was from its middle.
    pub furthest: f64,
    /// Where its mechanical stop is.
    pub end_stop: f64,
}

impl Findings {
    /// Whether the head did what it is to do, with the faults that there were: the gaze settles
    /// and stays, no limit is exceeded; without images it holds; safety stops it if and only if a
    /// sensor is stuck, and soon.
    pub fn is_good(&self) -> bool {
        let within = self.axes.iter().all(|axis| axis.furthest <= axis.end_stop);
        let bound = GAZE_BOUND.to_degrees();
        let is_settled = self.gaze_worst.is_some_and(|worst| worst < bound);
        let holds = |drift: f64| drift < HELD_DRIFT.to_degrees();
        let has_stuck = self.faults.iter().any(|fault| fault.starts_with("sensor"));
        let is_stopped = match self.stopped_after {
            Some(after) => has_stuck && after < STOP_WITHIN,
            None => !has_stuck && self.stopped_at.is_none(),
        };
        let duty = self.duty <= DUTY_LIMIT;
        within && duty && is_settled && is_stopped && self.held_drift.is_none_or(holds)
    }
}

/// Watches the machine while it runs; allocates nothing then.
#[derive(Debug)]
pub(crate) struct Judge {
    troubles: Vec<Trouble>,
    time: f64,
    gaze: f64,
    squares: f64,
    samples: u32,
    worst: f64,
    /// Where the axes were when the gaze began to hold, and the furthest from there.
    held: Option<[f64; AXES]>,
    drift: f64,
    stopped_at: Option<f64>,
    duty: f64,
    furthest: [f64; AXES],
}

impl Judge {
    pub(crate) fn new(troubles: Vec<Trouble>) -> Self {
        Self {
            troubles,
            time: 0.0,
            gaze: 0.0,
            squares: 0.0,
            samples: 0,
            worst: 0.0,
            held: None,
            drift: 0.0,
            stopped_at: None,
            duty: 0.0,
            furthest: [0.0; AXES],
        }
    }

    /// After a cycle of the machine.
    pub(crate) fn step(
        &mut self,
        time: f64,
        states: &[MotorState; AXES],
        drive: &Drive,
        target: &Vector3<f64>,
    ) {
        self.time = time;
        let pose = Pose::new(&states.map(|state| state.angle));
        let errors = pose.eyes.map(|eye| eye.error(target));
        self.gaze = errors[0].max(errors[1]);
        if self.is_to_be_settled(time) {
            self.squares += self.gaze * self.gaze;
            self.samples += 1;
            self.worst = self.worst.max(self.gaze);
        }
        if self.is_to_hold(time) {
            let held = self.held.get_or_insert(states.map(|state| state.angle));
            for (state, held) in states.iter().zip(held) {
                self.drift = self.drift.max((state.angle - *held).abs());
            }
        }
        if drive.is_stopped && self.stopped_at.is_none() {
            self.stopped_at = Some(time);
        }
        for (n, state) in states.iter().enumerate() {
            self.furthest[n] = self.furthest[n].max(state.angle.abs());
            self.duty = self.duty.max(drive.duties[n].abs());
        }
    }

    fn is_to_be_settled(&self, time: f64) -> bool {
        let mut troubles = self.troubles.iter();
        let disturbs = |trouble: &Trouble| {
            let after = time - trouble.at.as_secs_f64();
            after >= 0.0
                && match trouble.fault {
                    Fault::Sensor(_) => true,
                    Fault::Vision => after < trouble.lasts.as_secs_f64() + SETTLE,
                    Fault::Jump => after < SETTLE,
                }
        };
        time >= SETTLE && !troubles.any(disturbs)
    }

    fn is_to_hold(&self, time: f64) -> bool {
        let mut troubles = self.troubles.iter();
        troubles.any(|trouble| {
            let from = trouble.at.as_secs_f64() + HOLD_AFTER + REST;
            trouble.fault == Fault::Vision && time >= from && trouble.is_there(time)
        })
    }

    pub(crate) fn gaze_error(&self) -> f64 {
        self.gaze
    }

    pub(crate) fn findings(self) -> Findings {
        let stuck = self
            .troubles
            .iter()
            .find_map(|trouble| match trouble.fault {
                Fault::Sensor(_) => Some(trouble.at.as_secs_f64()),
                _ => None,
            });
        let has = self.samples > 0;
        let rms = (self.squares / f64::from(self.samples.max(1))).sqrt();
        Findings {
            seconds: self.time,
            gaze_rms: has.then(|| rms.to_degrees()),
            gaze_worst: has.then(|| self.worst.to_degrees()),
            held_drift: self.held.map(|_| self.drift.to_degrees()),
            stopped_at: self.stopped_at,
            stopped_after: self
                .stopped_at
                .zip(stuck)
                .map(|(stopped, stuck)| stopped - stuck)
                .filter(|after| *after >= 0.0),
            duty: self.duty,
            changed: 0,
            axes: (0..AXES)
                .map(|n| AxisFindings {
                    name: HEAD[n].name,
                    furthest: self.furthest[n].to_degrees(),
                    end_stop: HEAD[n].motor.end_stop.to_degrees(),
                })
                .collect(),
            faults: self
                .troubles
                .iter()
                .map(|trouble| name(trouble.fault))
                .collect(),
        }
    }
}

/// A fault as it is named on the command line.
pub fn name(fault: Fault) -> String {
    match fault {
        Fault::Vision => "vision".into(),
        Fault::Jump => "jump".into(),
        Fault::Sensor(axis) => format!("sensor-{}", HEAD[axis].name),
    }
}
