//! The motor's motion where it is linear, solved exactly: a whole step at once.
//!
//! While the joint moves one way, between its stops and below the limit of the current, friction is
//! a constant torque. Then speed and current are
//!
//! ```text
//! d/dt (ω, i) = A (ω, i) + g      A = | −b/J   K/J |    g = | −friction/J |
//!                                     | −K/L  −R/L |        |  voltage/L  |
//! ```
//!
//! They move from their values to those at rest, as sums of two exponentials. While the joint is
//! held by friction, only the current changes, by one exponential. A solution is used only if no
//! event that changes the equations can occur within the step: a reversal, breaking loose, a stop,
//! the limit. Otherwise the motor halves the step, or integrates it in sub-steps.

use super::{MotorParameters, MotorState};

/// The motion over steps of one length.
#[derive(Debug, Clone, Copy)]
pub(super) struct Exact {
    /// The length, in s.
    time: f64,
    k: f64,
    /// Maps speed and current before a step to those after it, as distances from their values at
    /// rest.
    transition: [[f64; 2]; 2],
    /// How far the joint turns in a step, by the same distances.
    turned: [f64; 2],
    /// The factor of the current's distance in a step while the joint is held.
    kept: f64,
    /// What both the speed and the current at rest are divided by.
    rigidity: f64,
}

impl Exact {
    /// For steps of `time` seconds. None if the equations do not have two real, well separated time
    /// constants (nearly every motor's do), or the armature has no resistance or inductance.
    pub(super) fn new(p: &MotorParameters, time: f64) -> Option<Self> {
        let k = p.joint_constant();
        let (inertia, inductance) = (p.inertia(), p.inductance);
        let rigidity = p.viscous_friction * p.resistance + k * k;
        let a = [
            [-p.viscous_friction / inertia, k / inertia],
            [-k / inductance, -p.resistance / inductance],
        ];
        let mean = (a[0][0] + a[1][1]) / 2.0;
        let determinant = rigidity / (inertia * inductance);
        let apart = mean * mean - determinant;
        let is_well_apart = apart.is_finite() && apart > 1e-4 * mean * mean;
        let fades = determinant > 0.0 && p.resistance > 0.0;
        if !is_well_apart || !fades {
            return None;
        }
        // The greater root first, and the other from it: their difference would lose the digits of
        // a slow one.
        let fast = mean - apart.sqrt();
        let slow = determinant / fast;
        // The exponential of A t is a sum of two matrices, one for each eigenvalue.
        let part = |value: f64, other: f64, row: usize, column: usize| {
            let diagonal = if row == column { other } else { 0.0 };
            (a[row][column] - diagonal) / (value - other)
        };
        let sum = |of_slow: f64, of_fast: f64, row, column| {
            of_slow * part(slow, fast, row, column) + of_fast * part(fast, slow, row, column)
        };
        let [by_slow, by_fast] = [slow, fast].map(|value| (value * time).exp());
        // Their integrals.
        let [slowly, quickly] = [slow, fast].map(|value| (value * time).exp_m1() / value);
        let transition = [0, 1].map(|row| [0, 1].map(|column| sum(by_slow, by_fast, row, column)));
        let turned = [0, 1].map(|column| sum(slowly, quickly, 0, column));
        Some(Self {
            time,
            k,
            transition,
            turned,
            kept: (a[1][1] * time).exp(),
            rigidity,
        })
    }

    /// The motor's state a step after `from` under `voltage`; none if the step may not be linear.
    /// O(1).
    pub(super) fn step(
        &self,
        p: &MotorParameters,
        from: MotorState,
        voltage: f64,
    ) -> Option<MotorState> {
        if from.speed == 0.0 {
            self.at_rest(p, from, voltage)
        } else {
            self.in_motion(p, from, voltage)
        }
    }

    /// While the joint is held, between its stops or in one.
    fn at_rest(&self, p: &MotorParameters, from: MotorState, voltage: f64) -> Option<MotorState> {
        let at_last = voltage / p.resistance;
        let current = at_last + (from.current - at_last) * self.kept;
        let depth = (from.angle.abs() - p.end_stop).max(0.0);
        let stop = (p.stop_stiffness * depth).copysign(from.angle);
        // The current is monotonic, so all values between are allowed if both ends are.
        let is_held = |current: f64| {
            (self.k * current - stop).abs() <= p.stiction && current.abs() <= p.current_limit
        };
        (is_held(from.current) && is_held(current)).then_some(MotorState { current, ..from })
    }

    /// While it moves one way, between its stops.
    fn in_motion(&self, p: &MotorParameters, from: MotorState, voltage: f64) -> Option<MotorState> {
        if from.angle.abs() > p.end_stop {
            return None;
        }
        let way = from.speed.signum();
        let friction = way * p.coulomb_friction;
        let rest_speed = (self.k * voltage - p.resistance * friction) / self.rigidity;
        let rest_current = (p.viscous_friction * voltage + self.k * friction) / self.rigidity;
        let distance = [from.speed - rest_speed, from.current - rest_current];
        let by = |row: [f64; 2]| row[0] * distance[0] + row[1] * distance[1];
        let to = MotorState {
            angle: from.angle + rest_speed * self.time + by(self.turned),
            speed: rest_speed + by(self.transition[0]),
            current: rest_current + by(self.transition[1]),
        };

        let speeding = |at: MotorState| {
            (self.k * at.current - p.viscous_friction * at.speed - friction) / p.inertia()
        };
        let slowest = self.extreme(from.speed, speeding(from), speeding(to));
        let moves_one_way = way * to.speed > 0.0 && way * slowest > 0.0;
        // What moves one way is between where it was and where it is.
        let is_free = to.angle.abs() <= p.end_stop;
        let rising = |at: MotorState| {
            (voltage - p.resistance * at.current - self.k * at.speed) / p.inductance
        };
        let most = self.extreme(from.current, rising(from), rising(to));
        let is_below_limit = [from.current, most, to.current]
            .iter()
            .all(|current| current.abs() <= p.current_limit);
        (moves_one_way && is_free && is_below_limit).then_some(to)
    }

    /// How far a value that begins at `from` may get beyond both of its ends in a step, if it
    /// begins and ends with these rates.
    ///
    /// A rate is a sum of two decaying exponentials: it changes its sign at most once, and its size
    /// does not grow before that. So with equal signs nothing lies beyond the ends; with different
    /// signs, at most what the first rate would reach in the whole step.
    fn extreme(&self, from: f64, rate: f64, rate_after: f64) -> f64 {
        if rate * rate_after < 0.0 {
            from + rate * self.time
        } else {
            from
        }
    }
}

/// The coefficients for the last step's length: most motors are stepped by one length.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prepared {
    time: f64,
    exact: Option<Exact>,
}

impl Prepared {
    /// Nothing.
    pub(super) const NONE: Self = Self {
        time: 0.0,
        exact: None,
    };

    /// The motion over steps of `time` seconds, above zero; kept if the last step had this length.
    pub(super) fn steps_of(&mut self, p: &MotorParameters, time: f64) -> Option<&Exact> {
        if self.time != time {
            *self = Self {
                time,
                exact: Exact::new(p, time),
            };
        }
        self.exact.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Motor, PAN, TILT};
    use proptest::prelude::*;

    /// The equations, integrated by the classical Runge-Kutta method in steps a hundredth of the
    /// armature's time constant.
    fn runge_kutta(p: &MotorParameters, from: MotorState, voltage: f64, time: f64) -> MotorState {
        let friction = p.coulomb_friction * from.speed.signum();
        let k = p.joint_constant();
        let rates = |[_, speed, current]: [f64; 3]| {
            [
                speed,
                (k * current - p.viscous_friction * speed - friction) / p.inertia(),
                (voltage - p.resistance * current - k * speed) / p.inductance,
            ]
        };
        let steps = (time / (0.01 * p.inductance / p.resistance)).ceil();
        let h = time / steps;
        let mut x = [from.angle, from.speed, from.current];
        let plus = |x: [f64; 3], by: f64, rate: [f64; 3]| [0, 1, 2].map(|n| x[n] + by * rate[n]);
        for _ in 0..steps as u64 {
            let first = rates(x);
            let second = rates(plus(x, h / 2.0, first));
            let third = rates(plus(x, h / 2.0, second));
            let last = rates(plus(x, h, third));
            let mean =
                [0, 1, 2].map(|n| (first[n] + 2.0 * second[n] + 2.0 * third[n] + last[n]) / 6.0);
            x = plus(x, h, mean);
        }
        let [angle, speed, current] = x;
        MotorState {
            angle,
            speed,
            current,
        }
    }

    proptest! {
        #![proptest_config(crate::seeded())]

        #[test]
        fn motion_is_what_the_equations_say(
            is_pan: bool, voltage in -12.0..12.0f64, time in 1e-5..2e-2f64,
            angle in -0.4..0.4f64, speed in -12.0..12.0f64, current in -2.4..2.4f64,
        ) {
            let p = if is_pan { PAN } else { TILT };
            let from = MotorState { angle, speed, current };
            let exact = Exact::new(&p, time).expect("its time constants are apart");
            let Some(to) = exact.step(&p, from, voltage) else { return Ok(()) };
            let expected = runge_kutta(&p, from, voltage, time);
            prop_assert!((to.angle - expected.angle).abs() < 1e-8, "{to:?}, {expected:?}");
            prop_assert!((to.speed - expected.speed).abs() < 1e-7, "{to:?}, {expected:?}");
            prop_assert!((to.current - expected.current).abs() < 1e-7, "{to:?}, {expected:?}");
        }

        #[test]
        fn nothing_happens_within_a_step_that_is_taken_for_linear(
            is_pan: bool, duty in -1.0..1.0f64, limit in 0.2..3.0f64,
            angle in -0.62..0.62f64, speed in -2.0..2.0f64, current in -2.4..2.4f64, rests: bool,
        ) {
            let p = MotorParameters { current_limit: limit, ..if is_pan { PAN } else { TILT } };
            let speed = if rests { 0.0 } else { speed };
            let from = MotorState { angle, speed, current };
            let time = 2e-3;
            let voltage = duty * p.supply;
            let exact = Exact::new(&p, time).expect("its time constants are apart");
            if exact.step(&p, from, voltage).is_none() { return Ok(()) }
            for part in 1..=200 {
                let time = time * f64::from(part) / 200.0;
                let exact = Exact::new(&p, time).expect("as before");
                // Without a check that the equations hold.
                let unbounded = MotorParameters { end_stop: 10.0, stop_stiffness: 0.0, stiction: 1e9, current_limit: f64::INFINITY, ..p };
                let Some(to) = exact.step(&unbounded, from, voltage) else {
                    return Err(TestCaseError::fail(format!("it reverses within {time} s")));
                };
                prop_assert!(to.current.abs() <= limit * (1.0 + 1e-12));
                if rests {
                    let stop = p.stop_stiffness * (angle.abs() - p.end_stop).max(0.0) * angle.signum();
                    prop_assert!((p.joint_constant() * to.current - stop).abs() <= p.stiction * (1.0 + 1e-12));
                } else {
                    prop_assert!(to.speed * speed > 0.0 && to.angle.abs() <= p.end_stop + 1e-12);
                }
            }
        }
    }

    #[test]
    fn steps_add_up() {
        for p in [PAN, TILT] {
            let p = MotorParameters {
                end_stop: f64::INFINITY,
                ..p
            };
            let moving = MotorState {
                speed: 0.5,
                current: 0.5,
                ..MotorState::default()
            };
            let run = |steps: u32| {
                let mut motor = Motor::new(p).starting_at(moving);
                for _ in 0..steps {
                    motor.drive(0.4, 0.12 / f64::from(steps));
                }
                motor.state()
            };
            let once = run(1);
            for steps in [7, 120, 1000] {
                let state = run(steps);
                assert!((state.angle - once.angle).abs() < 1e-11, "{steps} steps");
                assert!((state.speed - once.speed).abs() < 1e-11, "{steps} steps");
                assert!(
                    (state.current - once.current).abs() < 1e-11,
                    "{steps} steps"
                );
            }
        }
    }

    #[test]
    fn a_motor_that_swings_or_has_no_inductance_has_none() {
        let none = [
            MotorParameters {
                inductance: 0.5,
                ..PAN
            },
            MotorParameters {
                inductance: 0.0,
                ..PAN
            },
            MotorParameters {
                resistance: 0.0,
                ..PAN
            },
            MotorParameters {
                torque_constant: 0.0,
                viscous_friction: 0.0,
                ..PAN
            },
        ];
        for p in none {
            assert!(Exact::new(&p, 1e-3).is_none(), "{p:?}");
        }
    }
}
