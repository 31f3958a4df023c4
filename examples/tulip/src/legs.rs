//! The kinematics of a leg, by `nalgebra`. x is ahead, y to the left, z up. A foot stays level and
//! points ahead.

use crate::parameters::{HIP, LEG, SEGMENT};
use nalgebra::{Rotation3, Vector3};

/// The longest leg: a straight knee cannot be controlled.
const LONGEST: f64 = 2.0 * SEGMENT - 0.004;
const SHORTEST: f64 = 0.25;

/// The left or the right leg, as a number.
pub type Side = usize;

/// 1 for the left leg, −1 for the right one.
pub fn sign(side: Side) -> f64 {
    1.0 - 2.0 * side as f64
}

/// Where the ankle is, from the middle between the hips, with the joints at these angles: yaw,
/// roll and pitch of the hip, knee, pitch and roll of the ankle.
pub fn foot(side: Side, joints: &[f64; LEG]) -> Vector3<f64> {
    let [yaw, roll, pitch, knee, ..] = *joints;
    let segment = Vector3::new(0.0, 0.0, -SEGMENT);
    let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    let hip = about(Vector3::z_axis(), yaw)
        * about(Vector3::x_axis(), roll)
        * about(Vector3::y_axis(), pitch);
    let shank = hip * about(Vector3::y_axis(), knee);
    Vector3::new(0.0, sign(side) * HIP, 0.0) + hip * segment + shank * segment
}

/// The joints for an ankle at `foot`, from the middle between the hips. What is out of reach is
/// brought to the end of the reach, in the same direction.
pub fn joints(side: Side, foot: &Vector3<f64>) -> [f64; LEG] {
    let from_hip = foot - Vector3::new(0.0, sign(side) * HIP, 0.0);
    let length = from_hip.norm().clamp(SHORTEST, LONGEST);
    let direction = from_hip.normalize();
    let roll = direction.y.atan2(-direction.z);
    let swing = (-direction.x).atan2(direction.y.hypot(direction.z));
    let half = (length / (2.0 * SEGMENT)).acos();
    let (pitch, knee) = (swing - half, 2.0 * half);
    [0.0, roll, pitch, knee, -(pitch + knee), -roll]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_joints_bring_the_foot_there() {
        for side in [0, 1] {
            for [x, y, z] in [[0.0, 0.0, -0.5], [0.12, 0.05, -0.48], [-0.1, -0.04, -0.45]] {
                let wanted = Vector3::new(x, sign(side) * HIP + y, z);
                let reached = foot(side, &joints(side, &wanted));
                assert!((reached - wanted).norm() < 1e-9, "{wanted} {reached}");
            }
        }
    }

    #[test]
    fn what_is_out_of_reach_is_approached() {
        let far = Vector3::new(0.5, HIP, -0.5);
        let reached = foot(0, &joints(0, &far)) - Vector3::new(0.0, HIP, 0.0);
        assert!((reached.norm() - LONGEST).abs() < 1e-9);
        assert!((reached.x + reached.z).abs() < 1e-9, "{reached}");
    }
}
