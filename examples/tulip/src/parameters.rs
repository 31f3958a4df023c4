//! The joints, and all figures that are chosen. Lengths in m, angles in rad, times in s. The thesis
//! gives the joints and the modules; the other figures are of a plausible robot of 1.2 m.

use luna_plants::MotorParameters;
use std::time::Duration;

/// From one cycle of balance and of the joint controllers to the next: 1 kHz.
pub const PERIOD: Duration = Duration::from_millis(1);
/// [`PERIOD`] in s.
pub const DT: f64 = 1e-3;
/// Of the gait: 100 Hz.
pub const GAIT_PERIOD: Duration = Duration::from_millis(10);
/// Of the world model: 10 Hz.
pub const WORLD_PERIOD: Duration = Duration::from_millis(100);

/// From the ground to the centre of mass, which is between the hips.
pub const HEIGHT: f64 = 0.5;
/// The rate at which an inverted pendulum of this height falls, in 1/s.
pub const OMEGA: f64 = 4.429;
/// From the middle to a hip.
pub const HIP: f64 = 0.06;
/// From hip to knee, and from knee to ankle.
pub const SEGMENT: f64 = 0.275;
/// From the middle of a foot to its edges, ahead and beside.
pub const FOOT: [f64; 2] = [0.08, 0.04];
/// Balance keeps this far from the edges.
pub const EDGE: f64 = 0.008;
/// How stiff a leg's springs are: the centre of pressure moves by this times what the springs give
/// way. Above 1 the robot stands without control.
pub const STIFFNESS: f64 = 3.0;
/// How strongly the springs damp, in s.
pub const SPRING_DAMPING: f64 = 0.03;

/// A step's time.
pub const STEP_TIME: f64 = 0.5;
/// Between the feet, beside each other.
pub const WIDTH: f64 = 0.16;
/// The longest step that is planned, and the furthest foothold ahead or behind.
pub const STEP: f64 = 0.1;
/// The furthest foothold ahead or behind.
pub const REACH: f64 = 0.24;
/// The nearest and furthest foothold beside.
pub const BESIDE: [f64; 2] = [0.11, 0.28];
/// How high a foot is lifted.
pub const LIFT: f64 = 0.04;
/// The centre of mass may be so far from the feet, or the robot falls.
pub const FALLEN: f64 = 0.3;

/// How many joints there are.
pub const JOINTS: usize = 14;
/// Joints of a leg; the left one's are first, then the right one's, then the arms.
pub const LEG: usize = 6;

/// The most of a motor's supply.
pub const DUTY_LIMIT: f64 = 0.95;
/// How fast a duty may change, in 1/s.
pub const DUTY_RATE: f64 = 600.0;
/// A motor with at least this duty moves its joint ...
pub const DRIVEN: f64 = 0.15;
/// ... by this angle ...
pub const MOVED: f64 = 2e-3;
/// ... within this time, or something is stuck.
pub const STUCK_AFTER: Duration = Duration::from_millis(40);
/// A joint may be this far from its set-point ...
pub const FOLLOWS: f64 = 0.2;
/// ... for so long.
pub const ASTRAY_AFTER: Duration = Duration::from_millis(5);
/// So many readings may pass without a command from the controllers.
pub const SILENT: u32 = 20;
/// Safety has to stop the robot so soon after a fault of a joint.
pub const STOP_WITHIN: f64 = 0.6;

/// The natural frequency of a joint's controller, in rad/s.
pub const BANDWIDTH: f64 = 90.0;

const MOTOR: MotorParameters = MotorParameters {
    supply: 24.0,
    current_limit: f64::INFINITY,
    resistance: 1.2,
    inductance: 0.2e-3,
    torque_constant: 0.03,
    gear_ratio: 80.0,
    rotor_inertia: 5e-6,
    load_inertia: 0.02,
    viscous_friction: 0.02,
    coulomb_friction: 0.4,
    stiction: 0.5,
    end_stop: 1.0,
    stop_stiffness: 2000.0,
    stop_damping: 5.0,
};

/// One joint.
#[derive(Debug, Clone, Copy)]
pub struct Joint {
    /// Its name, in signals and on the command line.
    pub name: &'static str,
    /// The mechanism.
    pub motor: MotorParameters,
    /// The middle between its stops.
    pub middle: f64,
}

impl Joint {
    /// From its middle to where safety lets no motor push further.
    pub fn guard(&self) -> f64 {
        self.motor.end_stop - 0.08
    }
}

const fn joint(name: &'static str, low: f64, high: f64) -> Joint {
    Joint {
        name,
        motor: MotorParameters {
            end_stop: (high - low) / 2.0,
            ..MOTOR
        },
        middle: (high + low) / 2.0,
    }
}

/// The joints.
pub static ROBOT: [Joint; JOINTS] = [
    joint("left-hip-yaw", -0.5, 0.5),
    joint("left-hip-roll", -0.6, 0.6),
    joint("left-hip-pitch", -1.6, 0.7),
    joint("left-knee", -0.1, 2.2),
    joint("left-ankle-pitch", -1.2, 0.7),
    joint("left-ankle-roll", -0.6, 0.6),
    joint("right-hip-yaw", -0.5, 0.5),
    joint("right-hip-roll", -0.6, 0.6),
    joint("right-hip-pitch", -1.6, 0.7),
    joint("right-knee", -0.1, 2.2),
    joint("right-ankle-pitch", -1.2, 0.7),
    joint("right-ankle-roll", -0.6, 0.6),
    joint("left-shoulder", -1.5, 1.5),
    joint("right-shoulder", -1.5, 1.5),
];

/// The joint of this name.
pub fn joint_named(name: &str) -> Option<usize> {
    ROBOT.iter().position(|joint| joint.name == name)
}
