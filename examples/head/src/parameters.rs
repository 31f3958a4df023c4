//! The seven axes, and all figures that are chosen for them. Lengths in m, angles in rad, times in
//! s. The thesis gives the axes and the rates; the other figures are of a plausible head.

use luna_plants::MotorParameters;
use std::time::Duration;

/// From one cycle of the joint controllers to the next: 1 kHz.
pub const PERIOD: Duration = Duration::from_millis(1);
/// [`PERIOD`] in s.
pub const DT: f64 = 1e-3;
/// From one cycle of the motion control to the next: 60 Hz.
pub const MOTION_PERIOD: Duration = Duration::from_nanos(16_666_667);
/// [`MOTION_PERIOD`] in s.
pub const MOTION_DT: f64 = 1.0 / 60.0;
/// Images in a second.
pub const IMAGE_RATE: f64 = 30.0;
/// How long vision takes for an image.
pub const VISION_TIME: Duration = Duration::from_millis(25);
/// The gaze holds if the newest image in which the target was found is older than this.
pub const HOLD_AFTER: f64 = 0.25;

/// How many axes there are.
pub const AXES: usize = 7;
/// The first axis of the eyes; those before are of the neck.
pub const EYES: usize = 4;

/// Pixels of an image, across and down.
pub const PIXELS: [usize; 2] = [64, 48];
/// The focal length of a camera, in pixels.
pub const FOCAL: f64 = 52.0;

/// Where the joints are, each from the joint before it.
pub mod geometry {
    /// From the lower tilt up to the pan axis.
    pub const LOWER_NECK: f64 = 0.10;
    /// From the upper tilt up to the eyes.
    pub const UPPER_NECK: f64 = 0.09;
    /// From the upper tilt forward to the eyes.
    pub const FACE: f64 = 0.05;
    /// From the middle to an eye.
    pub const HALF_BASE: f64 = 0.035;
}

/// How fast the error of an image goes to zero, in 1/s.
pub const GAZE_GAIN: f64 = 12.0;
/// Added to the squares of what the axes can do, so that no set-point is sought at any price.
pub const DAMPING: f64 = 1e-3;

/// The gaze error counts as settled below this: 2 degrees.
pub const GAZE_BOUND: f64 = 0.035;
/// How long the head has to find the target, at the start and after a jump.
pub const SETTLE: f64 = 1.5;
/// While the gaze holds, no axis moves further than this: friction lets it creep a little.
pub const HELD_DRIFT: f64 = 0.01;
/// How long safety has to find a sensor that is stuck, while the target moves.
pub const STOP_WITHIN: f64 = 1.5;

/// A motor with at least this duty, four times what friction takes, moves its axis ...
pub const DRIVEN: f64 = 0.08;
/// ... by this angle within [`Axis::stuck_after`], or something is stuck.
pub const MOVED: f64 = 2e-3;
/// So many readings may pass without duties from the controllers.
pub const SILENT: u32 = 20;
/// The most of a motor's supply.
pub const DUTY_LIMIT: f64 = 0.9;
/// How fast a duty may change, in 1/s.
pub const DUTY_RATE: f64 = 400.0;

/// One axis with all that its processes need to know.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    /// Its name, in signals and on the command line.
    pub name: &'static str,
    /// The mechanism.
    pub motor: MotorParameters,
    /// Set-points are at most so far from the middle.
    pub range: f64,
    /// Safety lets no motor push further than this. The mechanical stop is further out still.
    pub guard: f64,
    /// The fastest set-point, in rad/s.
    pub speed: f64,
    /// The fastest change of it, in rad/s².
    pub acceleration: f64,
    /// How dear its motion is: the gaze is reached by cheap axes first.
    pub weight: f64,
    /// How fast it goes back to its middle, in 1/s, as far as the gaze allows it.
    pub comfort: f64,
    /// How long it may be driven without motion. An eye would be at its stop soon.
    pub stuck_after: Duration,
    /// The natural frequency of its controller, in rad/s.
    pub bandwidth: f64,
}

const NECK_MOTOR: MotorParameters = MotorParameters {
    supply: 24.0,
    current_limit: f64::INFINITY,
    resistance: 2.0,
    inductance: 0.3e-3,
    torque_constant: 0.03,
    gear_ratio: 120.0,
    rotor_inertia: 5e-6,
    load_inertia: 0.03,
    viscous_friction: 0.02,
    coulomb_friction: 0.6,
    stiction: 0.8,
    end_stop: 0.6,
    stop_stiffness: 2000.0,
    stop_damping: 5.0,
};

const EYE_MOTOR: MotorParameters = MotorParameters {
    supply: 12.0,
    current_limit: f64::INFINITY,
    resistance: 5.0,
    inductance: 0.2e-3,
    torque_constant: 0.01,
    gear_ratio: 50.0,
    rotor_inertia: 2e-7,
    load_inertia: 1e-4,
    viscous_friction: 1e-4,
    coulomb_friction: 0.02,
    stiction: 0.028,
    end_stop: 0.7,
    stop_stiffness: 20.0,
    stop_damping: 0.05,
};

const fn neck(name: &'static str, end_stop: f64, comfort: f64) -> Axis {
    Axis {
        name,
        motor: MotorParameters {
            end_stop,
            ..NECK_MOTOR
        },
        range: end_stop - 0.15,
        guard: end_stop - 0.1,
        speed: 1.5,
        acceleration: 15.0,
        weight: 25.0,
        comfort,
        stuck_after: Duration::from_millis(80),
        bandwidth: 50.0,
    }
}

const fn eye(name: &'static str) -> Axis {
    Axis {
        name,
        motor: EYE_MOTOR,
        range: EYE_MOTOR.end_stop - 0.15,
        guard: EYE_MOTOR.end_stop - 0.1,
        speed: 8.0,
        acceleration: 150.0,
        weight: 1.0,
        comfort: 4.0,
        stuck_after: Duration::from_millis(20),
        bandwidth: 100.0,
    }
}

/// The axes, from the base to the eyes. The eyes share their tilt.
pub static HEAD: [Axis; AXES] = [
    neck("neck-lower-tilt", 0.6, 0.3),
    neck("neck-pan", 1.5, 0.0),
    neck("neck-roll", 0.6, 2.0),
    neck("neck-upper-tilt", 0.8, 0.0),
    eye("eyes-tilt"),
    eye("left-eye-pan"),
    eye("right-eye-pan"),
];

/// The axis of this name.
pub fn axis_named(name: &str) -> Option<usize> {
    HEAD.iter().position(|axis| axis.name == name)
}
