//! What became of a run, judged by what the simulated robot has truly done.

use crate::balance::support;
use crate::mechanics::{Fault, Trouble};
use crate::messages::{Drive, Internal};
use crate::parameters::{DUTY_LIMIT, FALLEN, JOINTS, ROBOT, STOP_WITHIN};
use luna_plants::MotorState;
use nalgebra::Vector2;
use serde::Serialize;

/// What became of a run. Times in s, lengths in m.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Findings {
    /// How long the robot was watched.
    pub seconds: f64,
    /// The steps that it has done, and those that it was to do at least.
    pub steps: u32,
    /// The fewest that are good.
    pub steps_expected: u32,
    /// How far it has come ahead.
    pub distance: f64,
    /// When it fell.
    pub fallen_at: Option<f64>,
    /// At the end of each step, the capture point is so far within the edges of both feet's
    /// support; at least. Negative: outside. Absent without a step.
    pub capture_margin: Option<f64>,
    /// How often the joint controllers were exchanged.
    pub exchanges: u32,
    /// The exchanges that the operator asked for.
    pub exchanges_asked: u32,
    /// Slots that the joint loop missed right after an exchange.
    pub lost: u64,
    /// The largest duty of a motor.
    pub duty: f64,
    /// The duties that safety has changed.
    pub changed: u64,
    /// When safety has stopped the robot.
    pub stopped_at: Option<f64>,
    /// How long after the fault that was.
    pub stopped_after: Option<f64>,
    /// The joints.
    pub joints: Vec<JointFindings>,
    /// What the operator was shown last.
    pub shown: Vec<(Internal, f64)>,
    /// How often it was shown something.
    pub shown_times: u32,
    /// What went wrong, if anything did, as it is named on the command line.
    pub faults: Vec<String>,
}

/// What became of a joint. Angles in degrees.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JointFindings {
    /// Which.
    pub name: &'static str,
    /// The least and the greatest angle.
    pub range: [f64; 2],
    /// Where its mechanical stops are.
    pub stops: [f64; 2],
}

impl Findings {
    /// Whether the robot did what it is to do, with the faults that there were: it walks and does
    /// not fall, the capture point is within its support as each step ends, controllers are
    /// exchanged without a slot lost, and no actuator passes its limit. After a fault of a joint,
    /// safety stops it soon; a push alone does not.
    pub fn is_good(&self) -> bool {
        let within = self
            .joints
            .iter()
            .all(|joint| joint.range[0] >= joint.stops[0] && joint.range[1] <= joint.stops[1]);
        let has_to_stop = self.faults.iter().any(|fault| fault != "push");
        let is_stopped = match self.stopped_after {
            Some(after) => has_to_stop && after < STOP_WITHIN,
            None => !has_to_stop && self.stopped_at.is_none(),
        };
        let walks = self.steps >= self.steps_expected && self.fallen_at.is_none();
        let captured = self.capture_margin.is_some_and(|margin| margin >= 0.0);
        let exchanged = self.lost == 0 && self.exchanges >= self.exchanges_asked;
        within && self.duty <= DUTY_LIMIT && is_stopped && walks && captured && exchanged
    }
}

/// Watches the machine while it runs; allocates nothing then.
#[derive(Debug)]
pub(crate) struct Judge {
    troubles: Vec<Trouble>,
    time: f64,
    steps: u32,
    margin: f64,
    ahead: f64,
    fallen_at: Option<f64>,
    stopped_at: Option<f64>,
    duty: f64,
    ranges: [[f64; 2]; JOINTS],
}

impl Judge {
    pub(crate) fn new(troubles: Vec<Trouble>) -> Self {
        Self {
            troubles,
            time: 0.0,
            steps: 0,
            margin: f64::INFINITY,
            ahead: 0.0,
            fallen_at: None,
            stopped_at: None,
            duty: 0.0,
            ranges: [[f64::INFINITY, f64::NEG_INFINITY]; JOINTS],
        }
    }

    /// Whether the body does not move any more.
    pub(crate) fn has_ended(&self) -> bool {
        self.fallen_at.or(self.stopped_at).is_some()
    }

    /// A step has ended.
    pub(crate) fn landed(&mut self, capture: &Vector2<f64>, feet: &[Vector2<f64>; 2]) {
        self.steps += 1;
        self.ahead = self.ahead.max(feet[0].x).max(feet[1].x);
        let [low, high] = support(feet, 0.0);
        let within = (capture - low).min().min((high - capture).min());
        self.margin = self.margin.min(within);
    }

    /// The centre of mass is so far from the feet that carry it.
    pub(crate) fn stands(&mut self, distance: f64) {
        if distance.is_nan() || distance > FALLEN {
            self.fallen_at.get_or_insert(self.time);
        }
    }

    /// After a cycle of the machine.
    pub(crate) fn step(&mut self, time: f64, states: &[MotorState; JOINTS], drive: &Drive) {
        self.time = time;
        if drive.is_stopped {
            self.stopped_at.get_or_insert(time);
        }
        for (n, state) in states.iter().enumerate() {
            let [low, high] = &mut self.ranges[n];
            *low = low.min(state.angle);
            *high = high.max(state.angle);
            self.duty = self.duty.max(drive.duties[n].abs());
        }
    }

    pub(crate) fn findings(self) -> Findings {
        let broken = self
            .troubles
            .iter()
            .find_map(|trouble| match trouble.fault {
                Fault::Push => None,
                Fault::Sensor(_) | Fault::Controller(_) => Some(trouble.at.as_secs_f64()),
            });
        let after = self.stopped_at.zip(broken);
        let after = after.map(|(stopped, broken)| stopped - broken);
        let joints = ROBOT.iter().zip(self.ranges).map(|(joint, range)| {
            let stop = joint.motor.end_stop;
            JointFindings {
                name: joint.name,
                range: range.map(|end| (joint.middle + end).to_degrees()),
                stops: [-stop, stop].map(|end| (joint.middle + end).to_degrees()),
            }
        });
        Findings {
            seconds: self.time,
            steps: self.steps,
            steps_expected: 0,
            distance: self.ahead,
            fallen_at: self.fallen_at,
            capture_margin: (self.steps > 0).then_some(self.margin),
            exchanges: 0,
            exchanges_asked: 0,
            lost: 0,
            duty: self.duty,
            changed: 0,
            stopped_at: self.stopped_at,
            stopped_after: after.filter(|after| *after >= 0.0),
            joints: joints.collect(),
            shown: vec![],
            shown_times: 0,
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
        Fault::Push => "push".into(),
        Fault::Sensor(joint) => format!("sensor-{}", ROBOT[joint].name),
        Fault::Controller(joint) => format!("controller-{}", ROBOT[joint].name),
    }
}
