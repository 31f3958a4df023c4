//! Balance, at 1 kHz: it keeps the capture point where the gait wants it, by the joints of the leg
//! that stands, and moves the other foot.
//!
//! The *capture point* is where the centre of pressure must be for the robot to come to rest there.
//! It runs away from the centre of pressure, which must be below a foot. A leg with springs has its
//! centre of pressure where the springs push it to: so the joints go a little beyond the position
//! that is meant.

use crate::legs::joints;
use crate::mechanics::upright;
use crate::messages::{Body, Plan, Seen, SetPoint, Step};
use crate::parameters::{
    DT, EDGE, FOOT, HEIGHT, JOINTS, LEG, LIFT, OMEGA, ROBOT, STEP_TIME, STIFFNESS,
};
use nalgebra::{Vector2, Vector3};

/// Of a standing robot: how fast the capture point comes back, as a part of [`OMEGA`].
const STANDING_GAIN: f64 = 0.8;
/// The capture point is corrected in at least this time, in s.
const SHORTEST: f64 = 0.12;
/// The time constants of the filters of the centre of pressure and of the rates, in s.
const PRESSURE_TIME: f64 = 0.02;
const RATE_TIME: f64 = 0.008;
/// How fast a foot goes on down that has not met the ground in time, in m/s.
const DOWN: f64 = 0.1;
/// How far the arms swing, in rad for each m between the feet.
const ARMS: f64 = 2.0;

/// The rectangle below feet at these places, with `margin` left out at its edges: its corners.
pub fn support(feet: &[Vector2<f64>], margin: f64) -> [Vector2<f64>; 2] {
    let half = Vector2::new(FOOT[0] - margin, FOOT[1] - margin);
    let first = feet.first().copied().unwrap_or_default();
    let fold = |by: fn(&Vector2<f64>, &Vector2<f64>) -> Vector2<f64>| {
        feet.iter().fold(first, |corner, foot| by(&corner, foot))
    };
    [fold(Vector2::inf) - half, fold(Vector2::sup) + half]
}

/// The balance, without its channels. Its steps allocate nothing.
#[derive(Debug)]
pub struct Balance {
    body: Body,
    /// The leg that stands, if it is one.
    stance: Option<usize>,
    /// Whether the other one was seen in the air since.
    has_lifted: bool,
    pressure: Vector2<f64>,
    last: [f64; JOINTS],
    rates: [f64; JOINTS],
    has_begun: bool,
}

impl Default for Balance {
    fn default() -> Self {
        let upright = upright();
        let mut body = Body::default();
        for side in [0, 1] {
            let leg = leg(&upright, side);
            body.feet[side] = crate::legs::foot(side, &leg).xy();
        }
        Self {
            body,
            stance: None,
            has_lifted: false,
            pressure: Vector2::zeros(),
            last: upright,
            rates: [0.0; JOINTS],
            has_begun: false,
        }
    }
}

/// The joints of a leg among all.
pub fn leg(all: &[f64; JOINTS], side: usize) -> [f64; LEG] {
    std::array::from_fn(|n| all[side * LEG + n])
}

impl Balance {
    /// What it knows of the robot.
    pub fn body(&self) -> Body {
        self.body
    }

    /// The readings of a cycle.
    pub fn see(&mut self, seen: &Seen, plan: &Plan) {
        let body = &mut self.body;
        [body.mass, body.speed] = seen.body;
        body.capture = body.mass + body.speed / OMEGA;
        body.time = seen.time;
        let stance = match plan {
            Plan::Stand(_) => None,
            Plan::Step(step) => Some(step.stance),
        };
        if stance != self.stance {
            // The leg that takes over pushes nowhere yet.
            (self.stance, self.has_lifted) = (stance, false);
            self.pressure = Vector2::zeros();
        }
        if let Some(stance) = stance {
            let other = 1 - stance;
            // A leg without load has no springs that give way: its joints say where its foot is.
            let is_down = seen.contacts[other];
            self.has_lifted |= !is_down;
            if !is_down || !body.contacts[other] {
                let foot = crate::legs::foot(other, &leg(&seen.joints, other));
                body.feet[other] = body.mass + foot.xy();
            }
            if self.has_lifted && is_down {
                body.steps += 1;
                self.has_lifted = false;
            }
        }
        body.contacts = seen.contacts;
    }

    /// One cycle: the set-points of the joints. Real-time path: yes.
    pub fn step(&mut self, plan: &Plan) -> SetPoint {
        let body = self.body;
        let [wanted, standing] = match plan {
            Plan::Stand(at) => {
                let centre = (body.feet[0] + body.feet[1]) / 2.0;
                let pressure = body.capture + STANDING_GAIN * (body.capture - at);
                [within(pressure, &support(&body.feet, EDGE)), centre]
            }
            Plan::Step(step) => {
                let stance = body.feet[step.stance];
                let left = (step.began + STEP_TIME - body.time).max(SHORTEST);
                let growth = (OMEGA * left).exp();
                let pressure = (step.capture - body.capture * growth) / (1.0 - growth);
                [within(pressure, &support(&[stance], EDGE)), stance]
            }
        };
        // Relative to the foot, so that it goes on when the other foot takes over.
        let offset = wanted - standing;
        self.pressure += (offset - self.pressure) * (DT / PRESSURE_TIME).min(1.0);
        // Where the joints are to put the centre of mass, for the springs to push so.
        let posture = body.mass - self.pressure / STIFFNESS;
        let mut set = [0.0; JOINTS];
        for side in [0, 1] {
            let foot = match plan {
                Plan::Step(step) if step.stance != side => swing(step, body.time, &body.mass),
                _ => {
                    let foot = body.feet[side] - posture;
                    Vector3::new(foot.x, foot.y, -HEIGHT)
                }
            };
            let joints = joints(side, &foot);
            set[side * LEG..][..LEG].copy_from_slice(&joints);
        }
        let apart = body.feet[0].x - body.feet[1].x;
        set[2 * LEG] = ARMS * apart;
        set[2 * LEG + 1] = -ARMS * apart;
        self.limited(set)
    }

    fn limited(&mut self, mut set: [f64; JOINTS]) -> SetPoint {
        for (n, joint) in ROBOT.iter().enumerate() {
            let range = joint.guard() - 0.02;
            set[n] = set[n].clamp(joint.middle - range, joint.middle + range);
            let rate = (set[n] - self.last[n]) / DT;
            self.rates[n] += (rate - self.rates[n]) * (DT / RATE_TIME).min(1.0);
        }
        if !self.has_begun {
            self.rates = [0.0; JOINTS];
            self.has_begun = true;
        }
        self.last = set;
        SetPoint {
            joints: set,
            rates: self.rates,
        }
    }
}

/// `point`, or the nearest one within these corners.
pub fn within(point: Vector2<f64>, corners: &[Vector2<f64>; 2]) -> Vector2<f64> {
    point.sup(&corners[0]).inf(&corners[1])
}

/// The foot in the air, from the middle between the hips.
fn swing(step: &Step, time: f64, mass: &Vector2<f64>) -> Vector3<f64> {
    let time = time - step.began;
    let part = (time / STEP_TIME).clamp(0.0, 1.0);
    // Ahead while it is up.
    let ahead = ((part - 0.1) / 0.75).clamp(0.0, 1.0);
    let ahead = ahead * ahead * (3.0 - 2.0 * ahead);
    let over = (time - STEP_TIME).max(0.0);
    let up = LIFT * (std::f64::consts::PI * part).sin() - DOWN * over;
    let at = step.from + (step.to - step.from) * ahead - mass;
    Vector3::new(at.x, at.y, up - HEIGHT)
}
