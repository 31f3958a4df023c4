//! The simulated robot, and what goes wrong with it.
//!
//! **Modelled:** the body as one mass on a *linear inverted pendulum* (Kajita and others, 2001): it
//! stays at one height, and topples away from the centre of pressure. Fourteen motors with gear,
//! friction and stops. Legs with springs, as TUlip's have: the centre of pressure is where the
//! springs push it, by how far the body is from where the joints put it, and it stays below the
//! foot. Where a foot meets the ground follows from the joints alone. Sensors with noise.
//!
//! **Not modelled:** the mass of the legs and arms, vertical motion and impacts, rotation of the
//! body, feet that slip or turn over, the weight that the motors carry. The weight goes to the foot
//! that lands at once. A robot that safety has stopped hangs in its harness.

use crate::balance::{leg, support, within};
use crate::legs::{foot, joints, sign};
use crate::messages::{Drive, Readings};
use crate::outcome::{Findings, Judge};
use crate::parameters::{DT, HEIGHT, JOINTS, LEG, OMEGA, ROBOT, SPRING_DAMPING, STIFFNESS, WIDTH};
use luna_plants::{Encoder, Motor, MotorState};
use nalgebra::{Vector2, Vector3};
use std::time::Duration;

/// A foot that is higher carries nothing, in m.
const UP: f64 = 4e-3;
/// A foot on the ground carries its part again after this time, in s.
const SETTLED: f64 = 0.06;
/// The noise of the position and speed of the centre of mass: at most, in m and m/s.
const NOISE: [f64; 2] = [2e-4, 4e-3];
/// What a push adds to the speed, in m/s.
const PUSH: [f64; 2] = [0.06, 0.06];
/// Where the ball is at first and how fast it rolls ahead, in m and m/s.
const BALL: [f64; 2] = [1.2, 0.08];
/// The noise of where the camera sees the ball: at most, in m.
const CAMERA_NOISE: f64 = 0.04;

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The robot is pushed ahead and to the left.
    Push,
    /// The encoder of this joint stands, for good.
    Sensor(usize),
    /// The controller of this joint wants full duty, for good.
    Controller(usize),
}

/// A fault, and when it comes, from the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Trouble {
    /// What.
    pub fault: Fault,
    /// When.
    pub at: Duration,
}

/// The joints of a robot that stands upright.
pub fn upright() -> [f64; JOINTS] {
    let mut all = [0.0; JOINTS];
    for side in [0, 1] {
        let foot = Vector3::new(0.0, sign(side) * WIDTH / 2.0, -HEIGHT);
        all[side * LEG..][..LEG].copy_from_slice(&joints(side, &foot));
    }
    all
}

/// Which feet carry the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Support {
    Both,
    One(usize),
}

/// The machine.
#[derive(Debug)]
pub struct Mechanics {
    motors: [Motor; JOINTS],
    encoders: [Encoder; JOINTS],
    counts: [i32; JOINTS],
    troubles: Vec<Trouble>,
    cycle: u64,
    mass: Vector2<f64>,
    speed: Vector2<f64>,
    pressure: Vector2<f64>,
    feet: [Vector2<f64>; 2],
    heights: [f64; 2],
    support: Support,
    /// Whether the foot that carries nothing is in the air, and how long it is not.
    is_up: bool,
    on_ground: f64,
    posture: Vector2<f64>,
    noise: u32,
    judge: Judge,
}

impl Mechanics {
    /// Upright and at rest, with what will go wrong.
    pub fn new(troubles: Vec<Trouble>) -> Self {
        let upright = upright();
        Self {
            motors: std::array::from_fn(|n| {
                let angle = upright[n] - ROBOT[n].middle;
                Motor::new(ROBOT[n].motor).starting_at(MotorState {
                    angle,
                    ..MotorState::default()
                })
            }),
            encoders: ROBOT
                .each_ref()
                .map(|joint| Encoder::new(joint.motor.gear_ratio, 0)),
            counts: [0; JOINTS],
            judge: Judge::new(troubles.clone()),
            troubles,
            cycle: 0,
            mass: Vector2::zeros(),
            speed: Vector2::zeros(),
            pressure: Vector2::zeros(),
            feet: [0, 1].map(|side| Vector2::new(0.0, sign(side) * WIDTH / 2.0)),
            heights: [0.0; 2],
            support: Support::Both,
            is_up: false,
            on_ground: 0.0,
            posture: Vector2::zeros(),
            noise: 0x9e37_79b9,
        }
    }

    /// One cycle of the machine. Real-time path: yes.
    pub fn step(&mut self, drive: &Drive) {
        self.cycle += 1;
        let time = self.time();
        for n in 0..JOINTS {
            self.motors[n].drive(drive.duties[n], DT);
            if !self.has(Fault::Sensor(n)) {
                self.counts[n] = self.encoders[n].count(self.motors[n].state().angle);
            }
        }
        let is_pushed = |trouble: &Trouble| {
            let at = trouble.at.as_secs_f64();
            trouble.fault == Fault::Push && time >= at && time - DT < at
        };
        if self.troubles.iter().any(is_pushed) {
            self.speed += Vector2::from(PUSH);
        }
        let joints = self.joints();
        let relative = [0, 1].map(|side| foot(side, &leg(&joints, side)));
        if !self.judge.has_ended() {
            self.touch(&relative);
            self.topple(&relative);
        }
        let states = self.motors.each_ref().map(Motor::state);
        self.judge.step(time, &states, drive);
    }

    /// Which feet carry the robot now.
    fn touch(&mut self, relative: &[Vector3<f64>; 2]) {
        self.heights = relative.map(|foot| HEIGHT + foot.z);
        match self.support {
            Support::Both => {
                if let Some(side) = [0, 1].into_iter().find(|side| self.heights[*side] > UP) {
                    self.support = Support::One(1 - side);
                    self.is_up = true;
                }
            }
            Support::One(side) => {
                let other = 1 - side;
                if self.is_up {
                    self.feet[other] = self.mass + relative[other].xy();
                    if self.heights[other] <= 0.0 {
                        self.support = Support::One(other);
                        (self.is_up, self.on_ground) = (false, 0.0);
                        let capture = self.mass + self.speed / OMEGA;
                        self.judge.landed(&capture, &self.feet);
                    }
                } else if self.heights[other] > UP {
                    self.is_up = true;
                } else {
                    self.on_ground += DT;
                    if self.on_ground > SETTLED {
                        self.support = Support::Both;
                    }
                }
            }
        }
        if self.support != Support::Both && self.is_up {
            self.on_ground = 0.0;
        }
    }

    /// The body moves.
    fn topple(&mut self, relative: &[Vector3<f64>; 2]) {
        let posture = |side: usize| self.feet[side] - relative[side].xy();
        let (posture, centre, corners) = match self.support {
            Support::Both => (
                (posture(0) + posture(1)) / 2.0,
                (self.feet[0] + self.feet[1]) / 2.0,
                support(&self.feet, 0.0),
            ),
            Support::One(side) => (
                posture(side),
                self.feet[side],
                support(&[self.feet[side]], 0.0),
            ),
        };
        // Where the weight passes from foot to foot, the posture jumps, and no spring moves so fast.
        let change = ((posture - self.posture) / DT).cap_magnitude(2.0);
        self.posture = posture;
        let give = (self.mass - posture) + SPRING_DAMPING * (self.speed - change);
        self.pressure = within(centre + STIFFNESS * give, &corners);
        self.speed += OMEGA * OMEGA * (self.mass - self.pressure) * DT;
        self.mass += self.speed * DT;
        self.judge.stands((self.mass - centre).norm());
    }

    /// Whether this fault is there now.
    pub fn has(&self, fault: Fault) -> bool {
        let time = self.time();
        let mut troubles = self.troubles.iter();
        troubles.any(|trouble| trouble.fault == fault && time >= trouble.at.as_secs_f64())
    }

    /// Since the start, in s.
    pub fn time(&self) -> f64 {
        self.cycle as f64 * DT
    }

    /// What the sensors have.
    pub fn readings(&mut self) -> Readings {
        let body = [0, 1].map(|n| {
            let noise = Vector2::new(self.random(), self.random()) * NOISE[n];
            [self.mass, self.speed][n] + noise
        });
        let contact = |side: usize| match self.support {
            Support::One(stance) if stance != side => !self.is_up,
            _ => true,
        };
        Readings {
            counts: self.counts,
            contacts: [contact(0), contact(1)],
            body,
            time: self.time(),
        }
    }

    /// Where the camera sees the ball, from the robot.
    pub fn ball(&mut self) -> Vector2<f64> {
        let ball = Vector2::new(BALL[0] + BALL[1] * self.time(), 0.0);
        let noise = Vector2::new(self.random(), self.random());
        ball - self.mass + noise * CAMERA_NOISE
    }

    /// From −1 to 1, the same in each run: Marsaglia's xorshift.
    fn random(&mut self) -> f64 {
        self.noise ^= self.noise << 13;
        self.noise ^= self.noise >> 17;
        self.noise ^= self.noise << 5;
        f64::from(self.noise) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    /// Where the joints truly are, in rad.
    pub fn joints(&self) -> [f64; JOINTS] {
        std::array::from_fn(|n| ROBOT[n].middle + self.motors[n].state().angle)
    }

    /// The centre of mass, the capture point, the centre of pressure, and the feet; from the centre
    /// of mass but for itself.
    pub fn places(&self) -> [Vector2<f64>; 5] {
        let from = |place: Vector2<f64>| place - self.mass;
        [
            self.mass,
            self.speed / OMEGA,
            from(self.pressure),
            from(self.feet[0]),
            from(self.feet[1]),
        ]
    }

    /// How high the feet are.
    pub fn heights(&self) -> [f64; 2] {
        self.heights
    }

    /// What was found out about the run.
    pub fn findings(self) -> Findings {
        self.judge.findings()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Too fast for the feet, which stay where they are.
    #[test]
    fn it_falls() {
        let mut mechanics = Mechanics::new(vec![]);
        mechanics.speed.y = 1.0;
        for _ in 0..2000 {
            mechanics.step(&Drive::default());
        }
        let findings = mechanics.findings();
        assert!(findings.fallen_at.is_some() && !findings.is_good());
    }
}
