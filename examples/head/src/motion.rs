//! The motion control: from what vision has found to set-points of the joints, at 60 Hz.
//!
//! An image is late. So it is put together with where the head was when it was exposed, which gives
//! the target in space; from there its motion is predicted until now. If no image comes, the gaze
//! holds.

use crate::kinematics::{Joints, Pose, resolve, triangulate};
use crate::messages::{EXPOSURES, Seen, SetPoint, Sighting};
use crate::parameters::{AXES, HEAD, HOLD_AFTER, MOTION_DT};
use nalgebra::Vector3;

/// The filter's share of a new position, and of the speed that follows from it.
const POSITION_SHARE: f64 = 0.6;
const SPEED_SHARE: f64 = 0.25;
/// A target that is further from where it was expected, in m, has jumped.
const JUMP: f64 = 0.15;
/// Faster than this it is not, in m/s.
const FASTEST: f64 = 1.5;

/// Where the target is thought to be.
#[derive(Debug, Clone, Copy)]
struct Estimate {
    time: f64,
    point: Vector3<f64>,
    velocity: Vector3<f64>,
}

impl Estimate {
    fn at(&self, time: f64) -> Vector3<f64> {
        self.point + self.velocity * (time - self.time)
    }

    fn update(&mut self, time: f64, found: Vector3<f64>) {
        let passed = time - self.time;
        let expected = self.at(time);
        let surprise = found - expected;
        if surprise.norm() > JUMP {
            (self.point, self.velocity) = (found, Vector3::zeros());
        } else if passed > 0.0 {
            self.point = expected + POSITION_SHARE * surprise;
            self.velocity += SPEED_SHARE / passed * surprise;
            self.velocity = self.velocity.cap_magnitude(FASTEST);
        }
        self.time = time;
    }
}

/// The motion control, without its channels. Its steps allocate nothing.
#[derive(Debug, Default)]
pub struct Motion {
    target: Option<Estimate>,
    angles: [f64; AXES],
    rates: Joints,
}

impl Motion {
    /// Vision has found the target. An image that is older than those that safety remembers is
    /// dropped.
    pub fn sighting(&mut self, sighting: &Sighting, seen: &Seen) {
        let exposure = &seen.exposures[sighting.image as usize % EXPOSURES];
        let pose = Pose::new(&exposure.angles);
        if exposure.image != sighting.image {
            return;
        }
        if let Some(found) = triangulate(&pose, &sighting.eyes) {
            match &mut self.target {
                Some(target) => target.update(exposure.time, found),
                None => {
                    self.target = Some(Estimate {
                        time: exposure.time,
                        point: found,
                        velocity: Vector3::zeros(),
                    });
                }
            }
        }
    }

    /// Whether the target was seen lately.
    pub fn has_target(&self, time: f64) -> bool {
        let is_new = |target: &Estimate| time - target.time < HOLD_AFTER;
        self.target.as_ref().is_some_and(is_new)
    }

    /// One cycle: the set-points from `time` on. Real-time path: yes; a bounded number of solutions
    /// of three equations.
    pub fn step(&mut self, time: f64) -> SetPoint {
        for n in 0..AXES {
            self.angles[n] += self.rates[n] * MOTION_DT;
        }
        let has_target = self.has_target(time);
        let target = self.target.as_ref().filter(|_| has_target);
        let wanted = target.and_then(|target| {
            let point = target.at(time);
            resolve(&self.angles, &point, &target.velocity)
        });
        let wanted = wanted.unwrap_or_default();
        for (n, axis) in HEAD.iter().enumerate() {
            let most = axis.acceleration * MOTION_DT;
            let rate = self.rates[n] + (wanted[n] - self.rates[n]).clamp(-most, most);
            // Not beyond the range, whatever the acceleration may be.
            let [low, high] = [-axis.range, axis.range].map(|end| end - self.angles[n]);
            self.rates[n] = rate.clamp(low.min(0.0) / MOTION_DT, high.max(0.0) / MOTION_DT);
        }
        SetPoint {
            time,
            angles: self.angles,
            rates: self.rates.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::Exposure;

    /// A head that stands at zero, and a target at `point`.
    fn seen(image: u32, time: f64, point: &Vector3<f64>) -> (Seen, Sighting) {
        let mut seen = Seen::default();
        seen.exposures[image as usize % EXPOSURES] = Exposure {
            image,
            time,
            angles: [0.0; AXES],
        };
        let eyes = Pose::new(&[0.0; AXES]).eyes;
        let eyes = eyes.map(|eye| eye.image(point).unwrap());
        (seen, Sighting { image, eyes })
    }

    #[test]
    fn a_moving_target_is_predicted() {
        let mut motion = Motion::default();
        let velocity = Vector3::new(0.0, 0.4, -0.1);
        let start = Vector3::new(1.0, -0.3, 0.3);
        for image in 1..40 {
            let time = f64::from(image) / 30.0;
            let (seen, sighting) = seen(image, time, &(start + velocity * time));
            motion.sighting(&sighting, &seen);
        }
        let later = 39.0 / 30.0 + 0.06;
        let error = motion.target.unwrap().at(later) - (start + velocity * later);
        assert!(error.norm() < 2e-3, "{error}");
    }

    #[test]
    fn a_sighting_without_its_exposure_is_dropped() {
        let mut motion = Motion::default();
        let (seen, mut sighting) = seen(3, 0.1, &Vector3::new(1.0, 0.0, 0.2));
        sighting.image = 11;
        motion.sighting(&sighting, &seen);
        assert!(!motion.has_target(0.1));
    }

    #[test]
    fn the_set_points_hold_when_no_image_comes() {
        let mut motion = Motion::default();
        let (seen, sighting) = seen(1, 0.0, &Vector3::new(1.0, 0.3, 0.3));
        motion.sighting(&sighting, &seen);
        let at = |cycle: u32| f64::from(cycle) * MOTION_DT;
        for cycle in 0..10 {
            motion.step(at(cycle));
        }
        assert!(motion.rates.norm() > 0.1);
        let mut last = SetPoint::default();
        for cycle in 10..60 {
            last = motion.step(at(cycle));
        }
        assert_eq!(last.rates, [0.0; AXES]);
        assert!(last.angles[5] > 0.1);
    }
}
