//! The simulated machine: seven motors with encoders, two cameras, a target that moves, and faults.
//!
//! Each axis is a motor with its load, friction and end stops. Not modelled: gravity (the head is
//! balanced), what an axis does to the others, and play in the gears.

use crate::kinematics::Pose;
use crate::messages::{Drive, Image, Readings};
use crate::outcome::{Findings, Judge};
use crate::parameters::{AXES, DT, HEAD, IMAGE_RATE};
use crate::vision::Camera;
use luna_plants::{Encoder, Motor};
use nalgebra::Vector3;
use std::f64::consts::TAU;
use std::time::Duration;

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// No image comes any more, for a while.
    Vision,
    /// The encoder of this axis stands, for good.
    Sensor(usize),
    /// The target jumps, and stays there.
    Jump,
}

/// A fault, and when.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Trouble {
    /// What.
    pub fault: Fault,
    /// When, from the start.
    pub at: Duration,
    /// How long it lasts, if it does not for good.
    pub lasts: Duration,
}

impl Trouble {
    /// Whether it is there at `time` s.
    pub(crate) fn is_there(&self, time: f64) -> bool {
        let begin = self.at.as_secs_f64();
        let is_over = match self.fault {
            Fault::Vision => time >= begin + self.lasts.as_secs_f64(),
            Fault::Sensor(_) | Fault::Jump => false,
        };
        time >= begin && !is_over
    }
}

/// Where the target is at `time` s: it goes round in a curve ahead of the head.
pub fn target(time: f64, has_jumped: bool) -> Vector3<f64> {
    let phase = |period: f64| (TAU * time / period).sin();
    let jump = if has_jumped { -0.35 } else { 0.0 };
    Vector3::new(
        1.1 + 0.15 * phase(7.0),
        0.15 + 0.35 * phase(6.0) + jump,
        0.25 + 0.15 * phase(4.0),
    )
}

/// The machine.
#[derive(Debug)]
pub struct Mechanics {
    motors: [Motor; AXES],
    encoders: [Encoder; AXES],
    camera: Camera,
    troubles: Vec<Trouble>,
    cycle: u64,
    counts: [i32; AXES],
    image: u32,
    target: Vector3<f64>,
    judge: Judge,
}

impl Mechanics {
    /// At rest in the middle, with what will go wrong.
    pub fn new(troubles: Vec<Trouble>) -> Self {
        Self {
            motors: std::array::from_fn(|n| Motor::new(HEAD[n].motor)),
            encoders: std::array::from_fn(|n| Encoder::new(HEAD[n].motor.gear_ratio, 0)),
            camera: Camera::default(),
            judge: Judge::new(troubles.clone()),
            troubles,
            cycle: 0,
            counts: [0; AXES],
            image: 0,
            target: target(0.0, false),
        }
    }

    /// One cycle of the machine. Real-time path: yes.
    pub fn step(&mut self, drive: &Drive) {
        self.cycle += 1;
        let time = self.time();
        for n in 0..AXES {
            self.motors[n].drive(drive.duties[n], DT);
            if !self.has(Fault::Sensor(n), time) {
                self.counts[n] = self.encoders[n].count(self.motors[n].state().angle);
            }
        }
        self.target = target(time, self.has(Fault::Jump, time));
        let states = self.motors.each_ref().map(Motor::state);
        self.judge.step(time, &states, drive, &self.target);
    }

    fn has(&self, fault: Fault, time: f64) -> bool {
        let mut troubles = self.troubles.iter();
        troubles.any(|trouble| trouble.fault == fault && trouble.is_there(time))
    }

    /// Since the start, in s.
    pub fn time(&self) -> f64 {
        self.cycle as f64 * DT
    }

    /// The image of this cycle, if it is time for one.
    pub fn image(&mut self) -> Option<Image> {
        let number = (self.time() * IMAGE_RATE) as u32;
        if number == self.image {
            return None;
        }
        self.image = number;
        if self.has(Fault::Vision, self.time()) {
            return None;
        }
        let pose = Pose::new(&self.angles());
        let (camera, target) = (&mut self.camera, &self.target);
        Some(Image {
            number,
            eyes: pose.eyes.map(|eye| camera.expose(&eye, target)),
        })
    }

    /// What the hardware's registers have.
    pub fn readings(&self) -> Readings {
        Readings {
            counts: self.counts,
            time: self.time(),
            image: self.image,
        }
    }

    /// Where the joints are, in rad: what the sensors show if they are well.
    pub fn angles(&self) -> [f64; AXES] {
        self.motors.each_ref().map(|motor| motor.state().angle)
    }

    /// Where the target is.
    pub fn target(&self) -> Vector3<f64> {
        self.target
    }

    /// The angle between the eye that is further off and the target, in rad.
    pub fn gaze_error(&self) -> f64 {
        self.judge.gaze_error()
    }

    /// What was found out about the run.
    pub fn findings(self) -> Findings {
        self.judge.findings()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_target_jumps() {
        let at = Duration::ZERO;
        let jump = Trouble {
            fault: Fault::Jump,
            at,
            lasts: at,
        };
        let [jumps, stays] = [vec![jump], vec![]].map(|troubles| {
            let mut mechanics = Mechanics::new(troubles);
            mechanics.step(&Drive::default());
            mechanics.target()
        });
        assert!(((stays.y - jumps.y) - 0.35).abs() < 1e-12, "{jumps}");
    }
}
