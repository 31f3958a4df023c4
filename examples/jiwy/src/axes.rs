//! The two axes, and all figures that are chosen for them.

use crate::joystick::Deflection;
use crate::parts::{pid, sanity};
use luna_plants::{MotorParameters, PAN, TILT};

/// One axis with all that its processes need to know.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    /// What it is called in reports.
    pub name: &'static str,
    /// Which part of the joystick moves it.
    pub stick: fn(Deflection) -> f64,
    /// The mechanism.
    pub plant: MotorParameters,
    /// What the encoder's counter reads at angle 0.
    pub count_at_zero: i32,
    /// The controller.
    pub tuning: pid::Tuning,
    /// The safety layer.
    pub limits: sanity::Limits,
    /// Full deflection of the joystick, in rad.
    pub range: f64,
    /// The fastest that the set-point moves, in rad/s.
    pub max_speed: f64,
}

/// The two axes. Set-points end 0.2 and 0.1 rad before the stops, the guard begins 0.03 rad before
/// them.
pub static AXES: [Axis; 2] = [
    Axis {
        name: "pan",
        stick: |deflection| deflection.pan,
        plant: PAN,
        // Close to the counter's end, so that every run of the demo includes its wrap.
        count_at_zero: i32::MAX - 1000,
        tuning: pid::Tuning {
            bandwidth: 80.0,
            limit: 0.6,
        },
        limits: sanity::Limits {
            duty: 0.7,
            slew: 200.0,
            guard: 1.37,
        },
        range: 1.2,
        max_speed: 2.0,
    },
    Axis {
        name: "tilt",
        stick: |deflection| deflection.tilt,
        plant: TILT,
        count_at_zero: 0,
        tuning: pid::Tuning {
            bandwidth: 80.0,
            limit: 0.6,
        },
        limits: sanity::Limits {
            duty: 0.7,
            slew: 200.0,
            guard: 0.57,
        },
        range: 0.5,
        max_speed: 1.5,
    },
];
