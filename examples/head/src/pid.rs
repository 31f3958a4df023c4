//! The joint controller: the same for all axes, with other parameters.

use crate::parameters::{Axis, DT, DUTY_LIMIT};

/// A PID controller with feed-forward of the motor's back-EMF. Gains in V, rad and s.
#[derive(Debug, Clone, Copy)]
pub struct Pid {
    kp: f64,
    ki: f64,
    kd: f64,
    back_emf: f64,
    supply: f64,
    /// The part of the integral, in V.
    integral: f64,
    last: Option<f64>,
}

impl Pid {
    /// For `axis`: a critically damped loop of its bandwidth. The armature's inductance is left
    /// out.
    pub fn new(axis: &Axis) -> Self {
        let k = axis.motor.joint_constant();
        let per_volt = axis.motor.inertia() * axis.motor.resistance / k;
        let w = axis.bandwidth;
        let kp = w * w * per_volt;
        Self {
            kp,
            ki: kp * w / 8.0,
            kd: (2.0 * w * per_volt - k).max(0.0),
            back_emf: k,
            supply: axis.motor.supply,
            integral: 0.0,
            last: None,
        }
    }

    /// One cycle: the duty for a joint at `angle` that is to be at `set` and to move with `rate`.
    /// Real-time path: yes; O(1).
    pub fn step(&mut self, set: f64, rate: f64, angle: f64) -> f64 {
        let speed = (angle - self.last.unwrap_or(angle)) / DT;
        self.last = Some(angle);
        let error = set - angle;
        let direct = self.kp * error + self.kd * (rate - speed) + self.back_emf * rate;
        let most = DUTY_LIMIT * self.supply;
        let volts = direct + self.integral;
        // The integral does not grow while the motor gives all that it may.
        if volts.abs() < most || volts * error < 0.0 {
            self.integral = (self.integral + self.ki * error * DT).clamp(-most, most);
        }
        volts.clamp(-most, most) / self.supply
    }
}
