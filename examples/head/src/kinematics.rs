//! Where the eyes look, and how the axes move for it: linear algebra by `nalgebra`, with matrices
//! of fixed size, so that nothing is allocated.
//!
//! x is forward, y to the left, z up. The task has three numbers: where the left and the right eye
//! see the target beside their axes, and how far both see it above. Seven axes do it, so four
//! motions leave the gaze as it is. Those bring the eyes back to their middle, so the neck follows
//! the eyes.

use crate::parameters::geometry::{FACE, HALF_BASE, LOWER_NECK, UPPER_NECK};
use crate::parameters::{AXES, DAMPING, EYES, GAZE_GAIN, HEAD, MOTION_DT};
use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector3};

/// A number for each axis.
pub type Joints = SVector<f64, AXES>;
/// The change of the task with each axis.
pub type Jacobian = SMatrix<f64, 3, AXES>;

/// An eye: where it is, and how it is turned.
#[derive(Debug, Clone, Copy)]
pub struct Eye {
    /// Where.
    pub origin: Vector3<f64>,
    /// From its own axes (the first is where it looks) to those of the base.
    pub rotation: Rotation3<f64>,
}

impl Eye {
    /// A point as seen from the eye.
    fn local(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.inverse() * (point - self.origin)
    }

    /// The tangents of the angles to the left and up under which the eye sees `point`; none if it
    /// is not ahead of the eye.
    pub fn image(&self, point: &Vector3<f64>) -> Option<[f64; 2]> {
        let at = self.local(point);
        (at.x > 0.05).then(|| [at.y / at.x, at.z / at.x])
    }

    /// The direction of the ray that is seen under these tangents.
    pub fn ray(&self, [left, up]: [f64; 2]) -> Vector3<f64> {
        self.rotation * Vector3::new(1.0, left, up).normalize()
    }

    /// The angle between where it looks and `point`, in rad.
    pub fn error(&self, point: &Vector3<f64>) -> f64 {
        self.local(point).angle(&Vector3::x())
    }
}

/// The head with its joints at given angles.
#[derive(Debug, Clone, Copy)]
pub struct Pose {
    /// The left and the right eye.
    pub eyes: [Eye; 2],
    /// Of each joint its axis and a point on it.
    joints: [(Vector3<f64>, Vector3<f64>); AXES],
}

impl Pose {
    /// At these angles.
    pub fn new(angles: &[f64; AXES]) -> Self {
        let [x, y, z] = [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()];
        let mut joints = [(Vector3::zeros(), Vector3::zeros()); AXES];
        let mut at = Vector3::zeros();
        let mut turned = Rotation3::identity();
        let after = [
            (y, Vector3::new(0.0, 0.0, LOWER_NECK)),
            (z, Vector3::zeros()),
            (x, Vector3::zeros()),
            (y, Vector3::new(FACE, 0.0, UPPER_NECK)),
            (y, Vector3::zeros()),
        ];
        for (n, (axis, link)) in after.into_iter().enumerate() {
            joints[n] = (turned * axis.into_inner(), at);
            turned *= Rotation3::from_axis_angle(&axis, angles[n]);
            at += turned * link;
        }
        let eyes = [0, 1].map(|eye| {
            let side = [HALF_BASE, -HALF_BASE][eye];
            let origin = at + turned * Vector3::new(0.0, side, 0.0);
            joints[EYES + 1 + eye] = (turned * z.into_inner(), origin);
            let pan = Rotation3::from_axis_angle(&z, angles[EYES + 1 + eye]);
            let rotation = turned * pan;
            Eye { origin, rotation }
        });
        Self { eyes, joints }
    }

    /// What the task is at `point`, and how it changes with the axes and with the point; none if
    /// an eye does not see it.
    pub fn task(&self, point: &Vector3<f64>) -> Option<Task> {
        let mut task = Task::default();
        for (n, eye) in self.eyes.iter().enumerate() {
            let [left, up] = eye.image(point)?;
            let depth = eye.local(point).x;
            let to_eye = eye.rotation.inverse();
            // How the two tangents change when the point moves.
            let change = |motion: Vector3<f64>| {
                let motion = to_eye * motion;
                let beside = (motion.y - left * motion.x) / depth;
                let above = (motion.z - up * motion.x) / depth;
                (beside, above)
            };
            let row = 2 * n;
            task.error[row] = left;
            task.error[1] += up / 2.0;
            for (column, (axis, on_axis)) in self.joints.iter().enumerate() {
                let is_other_eye = column > EYES && column != EYES + 1 + n;
                if !is_other_eye {
                    // A joint that turns the eye is a point that turns the other way.
                    let (beside, above) = change(-axis.cross(&(point - on_axis)));
                    task.by_axes[(row, column)] = beside;
                    task.by_axes[(1, column)] += above / 2.0;
                }
            }
            for column in 0..3 {
                let (beside, above) = change(Vector3::ith(column, 1.0));
                task.by_point[(row, column)] = beside;
                task.by_point[(1, column)] += above / 2.0;
            }
        }
        Some(task)
    }
}

/// The gaze as three numbers that are to be zero: the target left of the left eye's axis, above
/// both axes, left of the right eye's axis.
#[derive(Debug, Clone, Copy, Default)]
pub struct Task {
    /// The numbers.
    pub error: Vector3<f64>,
    /// Their change with the axes.
    pub by_axes: Jacobian,
    /// Their change with the target.
    pub by_point: Matrix3<f64>,
}

/// The rates of the axes that bring the gaze to a target at `point` which moves with `velocity`
/// (m/s), from `angles`; none if an eye does not see it. No axis leaves its range or exceeds its
/// speed. At most [`AXES`] solutions of three equations; allocates nothing.
pub fn resolve(
    angles: &[f64; AXES],
    point: &Vector3<f64>,
    velocity: &Vector3<f64>,
) -> Option<Joints> {
    let task = Pose::new(angles).task(point)?;
    let wanted = -GAZE_GAIN * task.error - task.by_point * velocity;
    let mut is_free = [true; AXES];
    let mut rates = Joints::zeros();
    for _ in 0..AXES {
        rates = weighted(&task.by_axes, &wanted, &comfort(angles, &is_free), &is_free)?;
        let beyond = |n: usize| {
            let next = angles[n] + rates[n] * MOTION_DT;
            next.abs() - HEAD[n].range
        };
        let free = (0..AXES).filter(|n| is_free[*n] && beyond(*n) > 0.0);
        // The others do what the one that is furthest out cannot.
        match free.max_by(|a, b| beyond(*a).total_cmp(&beyond(*b))) {
            Some(worst) => is_free[worst] = false,
            None => break,
        }
    }
    let excess = (0..AXES).map(|n| rates[n].abs() / HEAD[n].speed);
    Some(rates / excess.fold(1.0, f64::max))
}

/// The rates that bring the axes back to their middle.
fn comfort(angles: &[f64; AXES], is_free: &[bool; AXES]) -> Joints {
    Joints::from_fn(|n, _| match is_free[n] {
        true => -HEAD[n].comfort * angles[n],
        false => 0.0,
    })
}

/// The rates that come nearest to `preferred`, weighted, among those that change the task as
/// `wanted`: the weighted and damped pseudo-inverse, and its null space.
fn weighted(
    by_axes: &Jacobian,
    wanted: &Vector3<f64>,
    preferred: &Joints,
    is_free: &[bool; AXES],
) -> Option<Joints> {
    let mut scaled = by_axes.transpose();
    for (n, mut row) in scaled.row_iter_mut().enumerate() {
        row *= if is_free[n] {
            1.0 / HEAD[n].weight
        } else {
            0.0
        };
    }
    let square = by_axes * scaled + Matrix3::identity() * DAMPING;
    let solved = square.cholesky()?.solve(&(wanted - by_axes * preferred));
    Some(preferred + scaled * solved)
}

/// The point next to the rays of both eyes, which see the target under these tangents; none if the
/// rays are parallel.
pub fn triangulate(pose: &Pose, seen: &[[f64; 2]; 2]) -> Option<Vector3<f64>> {
    let mut square = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for (eye, seen) in pose.eyes.iter().zip(seen) {
        let ray = eye.ray(*seen);
        let across = Matrix3::identity() - ray * ray.transpose();
        square += across;
        right += across * eye.origin;
    }
    // Rays that nearly agree meet nowhere in particular.
    (square.determinant() > 1e-5).then(|| square.cholesky().map(|square| square.solve(&right)))?
}

#[cfg(test)]
mod tests {
    use super::*;

    const ANGLES: [f64; AXES] = [0.1, -0.3, 0.2, 0.15, -0.2, 0.25, 0.1];

    fn target() -> Vector3<f64> {
        Vector3::new(1.1, -0.2, 0.35)
    }

    #[test]
    fn the_jacobians_are_the_slopes() {
        let task = Pose::new(&ANGLES).task(&target()).unwrap();
        let h = 1e-6;
        for n in 0..AXES {
            let mut moved = ANGLES;
            moved[n] += h;
            let moved = Pose::new(&moved).task(&target()).unwrap();
            let slope = (moved.error - task.error) / h;
            assert!((slope - task.by_axes.column(n)).norm() < 1e-4, "axis {n}");
        }
        for n in 0..3 {
            let moved = target() + Vector3::ith(n, h);
            let moved = Pose::new(&ANGLES).task(&moved).unwrap();
            let slope = (moved.error - task.error) / h;
            assert!((slope - task.by_point.column(n)).norm() < 1e-4, "{n}");
        }
    }

    #[test]
    fn the_gaze_comes_to_the_target_and_the_eyes_to_their_middle() {
        let mut angles = [0.0; AXES];
        let point = Vector3::new(1.0, 0.5, 0.4);
        for cycle in 0..600 {
            let rates = resolve(&angles, &point, &Vector3::zeros()).unwrap();
            // The eyes are cheap.
            assert!(
                cycle > 0 || rates[EYES + 1].abs() > 5.0 * rates[1].abs(),
                "{rates}"
            );
            for n in 0..AXES {
                angles[n] += rates[n] * MOTION_DT;
                assert!(angles[n].abs() <= HEAD[n].range + 1e-9, "axis {n}");
                assert!(rates[n].abs() <= HEAD[n].speed + 1e-9, "axis {n}");
            }
            // The eyes are there first; the neck goes on, and the gaze stays.
            let errors = Pose::new(&angles).eyes.map(|eye| eye.error(&point));
            assert!(cycle < 60 || errors[0].max(errors[1]) < 5e-3, "{errors:?}");
        }
        let is_in_the_middle = |angle: &f64| angle.abs() < 0.1;
        assert!(angles[EYES..].iter().all(is_in_the_middle), "{angles:?}");
        assert!(angles[1] > 0.3, "{angles:?}");
    }

    #[test]
    fn an_axis_at_its_end_leaves_the_gaze_to_the_others() {
        let mut angles = [0.0; AXES];
        // Straight up ahead: more than the upper tilt and the eyes reach.
        let point = Vector3::new(0.35, 0.0, 1.0);
        for _ in 0..900 {
            let rates = resolve(&angles, &point, &Vector3::zeros()).unwrap();
            for n in 0..AXES {
                angles[n] += rates[n] * MOTION_DT;
                assert!(angles[n].abs() <= HEAD[n].range + 1e-9, "axis {n}");
            }
        }
        let is_at_end = |n: usize| angles[n].abs() > HEAD[n].range - 0.02;
        assert!((0..AXES).any(is_at_end), "{angles:?}");
        let error = Pose::new(&angles).eyes[0].error(&point);
        assert!(error < 0.02, "{error} at {angles:?}");
    }

    #[test]
    fn two_rays_meet_at_the_target() {
        let pose = Pose::new(&ANGLES);
        let seen = pose.eyes.map(|eye| eye.image(&target()).unwrap());
        let found = triangulate(&pose, &seen).unwrap();
        assert!((found - target()).norm() < 1e-9);
        assert_eq!(triangulate(&pose, &[[0.0, 0.0], [0.15, 0.0]]), None);
    }
}
