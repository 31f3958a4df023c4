//! A PID that was generated as C, and the same one in Rust.

use luna_external_code::Submodel;

/// Two inputs (set-point and angle, in rad), one output (duty), four states, five parameters, as in
/// `controller/pid.h`.
pub type GeneratedPid = Submodel<2, 1, 4, 5>;

mod generated {
    unsafe extern "C" {
        pub(super) fn pid_initialize(u: *const f64, y: *mut f64, x: *mut f64, p: *mut f64, t: f64);
        pub(super) fn pid_step(u: *const f64, y: *mut f64, x: *mut f64, p: *mut f64, t: f64);
    }
}

/// The controller of `controller/pid.c`.
pub fn generated_pid() -> GeneratedPid {
    // SAFETY: the array lengths of the type are those of pid.h, which pid.c keeps to; it uses no
    // globals.
    unsafe { Submodel::new(generated::pid_initialize, generated::pid_step) }
}

/// The same controller in Rust.
#[derive(Debug, Clone)]
pub struct Pid {
    integral: f64,
    speed: f64,
    last_angle: f64,
    last_time: f64,
}

const KP: f64 = 1.2;
const KI: f64 = 6.0;
const KD: f64 = 0.02;
const FILTER: f64 = 0.002;
const LIMIT: f64 = 0.6;

impl Pid {
    /// At rest at `angle` and `time`.
    pub fn new(angle: f64, time: f64) -> Self {
        Self {
            integral: 0.0,
            speed: 0.0,
            last_angle: angle,
            last_time: time,
        }
    }

    /// The duty for the target and the measurement at `time`.
    pub fn step(&mut self, set_point: f64, angle: f64, time: f64) -> f64 {
        let h = time - self.last_time;
        let error = set_point - angle;
        if h > 0.0 {
            let speed = (angle - self.last_angle) / h;
            self.speed += (speed - self.speed) * h / (FILTER + h);
        }
        let rest = KP * error - KD * self.speed;
        let grown = self.integral + KI * error * h;
        let winds_up =
            (rest + grown > LIMIT && error > 0.0) || (rest + grown < -LIMIT && error < 0.0);
        if !winds_up {
            self.integral = grown;
        }
        (self.last_angle, self.last_time) = (angle, time);
        (rest + self.integral).clamp(-LIMIT, LIMIT)
    }
}
