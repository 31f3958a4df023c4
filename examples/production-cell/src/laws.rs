//! Control laws: implementations of a unit's controller, which can be exchanged while it runs.

use crate::messages::Goal;
use crate::parameters::{DT, MOTOR_TIME, Parameters, RESERVE};

/// A control law. Real-time path: yes; O(1), no allocation.
pub trait Law {
    /// The duty for the next cycle, from the measured position, in m.
    fn step(&mut self, goal: Goal, position: f64) -> f64;

    /// Takes over from another law at this position.
    fn take_over(&mut self, position: f64);
}

/// The laws of a unit, by their numbers in [`Request::law`](crate::messages::Request::law).
pub fn all(parameters: &Parameters) -> [Box<dyn Law + Send>; 2] {
    let speed = parameters.speed;
    [
        Box::new(Cascade(Inner::new(speed, 0.5))),
        Box::new(Braking {
            inner: Inner::new(speed, 1.0),
            deceleration: 0.2 * speed / MOTOR_TIME,
        }),
    ]
}

/// The speed loop of both: feed-forward and a proportional part.
struct Inner {
    speed: f64,
    gain: f64,
    last: Option<f64>,
}

impl Inner {
    fn new(speed: f64, gain: f64) -> Self {
        let last = None;
        Self { speed, gain, last }
    }

    fn duty(&mut self, wanted: f64, position: f64) -> f64 {
        let measured = (position - self.last.unwrap_or(position)) / DT;
        self.last = Some(position);
        let wanted = wanted.clamp(-self.speed, self.speed);
        let full = RESERVE * self.speed;
        ((wanted + self.gain * (wanted - measured)) / full).clamp(-1.0, 1.0)
    }
}

/// A proportional position loop around a speed loop.
struct Cascade(Inner);

impl Law for Cascade {
    fn step(&mut self, goal: Goal, position: f64) -> f64 {
        let wanted = match goal {
            Goal::Speed(speed) => speed,
            Goal::Position(target) => 15.0 * (target - position),
        };
        self.0.duty(wanted, position)
    }

    fn take_over(&mut self, position: f64) {
        self.0.last = Some(position);
    }
}

/// As fast as the brake allows: the speed falls with the root of the distance, near the target with
/// the distance.
struct Braking {
    inner: Inner,
    deceleration: f64,
}

impl Law for Braking {
    fn step(&mut self, goal: Goal, position: f64) -> f64 {
        let wanted = match goal {
            Goal::Speed(speed) => speed,
            Goal::Position(target) => {
                let way = target - position;
                let speed = (2.0 * self.deceleration * way.abs()).sqrt();
                speed.min(20.0 * way.abs()).copysign(way)
            }
        };
        self.inner.duty(wanted, position)
    }

    fn take_over(&mut self, position: f64) {
        self.inner.last = Some(position);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanics::Mechanics;
    use crate::messages::Drive;
    use crate::parameters::{REACH, Unit};

    #[test]
    fn every_law_brings_every_arm_to_its_target_in_time() {
        for unit in [
            Unit::Feeder,
            Unit::MoulderDoor,
            Unit::Extractor,
            Unit::Robot,
        ] {
            let parameters = unit.parameters();
            for mut law in all(parameters) {
                let mut mechanics = Mechanics::new(unit);
                let goal = Goal::Position(parameters.give);
                for _ in 0..1000 {
                    let duty = law.step(goal, mechanics.sensors().position);
                    let release = false;
                    mechanics.step(Drive { duty, release });
                }
                let left = parameters.give - mechanics.sensors().position;
                assert!(left.abs() < REACH / 4.0, "{unit:?}: {left}");
            }
        }
    }
}
