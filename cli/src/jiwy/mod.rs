//! Jiwy, the pan-tilt camera of the thesis (appendix A.1), with a simulated mechanism.

pub(crate) mod network;
pub(crate) mod pid;
mod processes;
pub(crate) mod sanity;
pub(crate) mod set_point;
pub(crate) mod tracking;

#[cfg(test)]
mod tests;

use crate::joystick::Deflection;
use luna_plants::{MotorParameters, PAN, TILT};

/// One axis with all that its processes need to know.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Axis {
    /// What it is called in reports.
    pub(crate) name: &'static str,
    /// Which part of the joystick moves it.
    pub(crate) stick: fn(Deflection) -> f64,
    /// The mechanism.
    pub(crate) plant: MotorParameters,
    /// What the encoder's counter reads at angle 0.
    pub(crate) count_at_zero: i32,
    /// The controller.
    pub(crate) tuning: pid::Tuning,
    /// The safety layer.
    pub(crate) limits: sanity::Limits,
    /// Full deflection of the joystick, in rad.
    pub(crate) range: f64,
    /// The fastest that the set-point moves, in rad/s.
    pub(crate) max_speed: f64,
}

/// The two axes. Set-points end 0.2 and 0.1 rad before the stops, the guard begins 0.03 rad before them.
pub(crate) static AXES: [Axis; 2] = [
    Axis {
        name: "pan",
        stick: |deflection| deflection.pan,
        plant: PAN,
        // Close to the counter's end, so that every run of the demo passes its wrap.
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
