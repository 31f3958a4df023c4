//! What the modules send each other. All is plain data without references.

use crate::legs::Side;
use crate::parameters::JOINTS;
use nalgebra::Vector2;

/// What the sensors have: from the simulated machine, for safety.
#[derive(Debug, Clone, Copy, Default)]
pub struct Readings {
    /// The encoders' counters.
    pub counts: [i32; JOINTS],
    /// What the feet press on, left and right.
    pub contacts: [bool; 2],
    /// The centre of mass, from the start, and its speed.
    pub body: [Vector2<f64>; 2],
    /// Since the start, in s.
    pub time: f64,
}

/// The readings that safety has checked, for balance and the joint controllers.
#[derive(Debug, Clone, Copy, Default)]
pub struct Seen {
    /// The joints.
    pub joints: [f64; JOINTS],
    /// As in [`Readings`].
    pub contacts: [bool; 2],
    /// As in [`Readings`].
    pub body: [Vector2<f64>; 2],
    /// Since the start, in s.
    pub time: f64,
}

/// Balance to the gait and to the world model.
#[derive(Debug, Clone, Copy, Default)]
pub struct Body {
    /// Since the start, in s.
    pub time: f64,
    /// The centre of mass.
    pub mass: Vector2<f64>,
    /// Its speed.
    pub speed: Vector2<f64>,
    /// The capture point: where the centre of pressure must be for the robot to come to rest there.
    pub capture: Vector2<f64>,
    /// The feet.
    pub feet: [Vector2<f64>; 2],
    /// Which of them touch the ground.
    pub contacts: [bool; 2],
    /// How many steps it has seen end, by the pressure below the foot.
    pub steps: u32,
}

/// The gait to balance.
#[derive(Debug, Clone, Copy)]
pub enum Plan {
    /// On both feet, with the capture point here.
    Stand(Vector2<f64>),
    /// On one foot.
    Step(Step),
}

/// A step.
#[derive(Debug, Clone, Copy)]
pub struct Step {
    /// Its number.
    pub number: u32,
    /// Which leg stands.
    pub stance: Side,
    /// When it began, in s since the start.
    pub began: f64,
    /// Where the other foot was then.
    pub from: Vector2<f64>,
    /// Where it is to go.
    pub to: Vector2<f64>,
    /// Where the capture point is to be at the end.
    pub capture: Vector2<f64>,
}

/// Balance to the joint controllers.
#[derive(Debug, Clone, Copy, Default)]
pub struct SetPoint {
    /// Where the joints are to be.
    pub joints: [f64; JOINTS],
    /// How fast they are to be.
    pub rates: [f64; JOINTS],
}

/// The joint controllers to safety.
#[derive(Debug, Clone, Copy, Default)]
pub struct Command {
    /// −1 to 1 of the supply.
    pub duties: [f64; JOINTS],
    /// What the joints are to reach.
    pub set: [f64; JOINTS],
}

/// Safety to the motors.
#[derive(Debug, Clone, Copy, Default)]
pub struct Drive {
    /// −1 to 1 of the supply.
    pub duties: [f64; JOINTS],
    /// Whether safety has stopped the robot.
    pub is_stopped: bool,
}

/// The world model to the gait.
#[derive(Debug, Clone, Copy, Default)]
pub struct Wish {
    /// Whether to walk.
    pub walk: bool,
    /// How long steps are to be.
    pub step: f64,
}

/// The operator to the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Request {
    /// Whether to follow the ball.
    pub walk: bool,
    /// Which of the controllers is to work.
    pub law: u8,
    /// What is to be shown.
    pub show: [Internal; 3],
}

/// An internal value that the operator can choose to see.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Internal {
    /// From the robot to where the world model thinks that the ball is, in m.
    BallDistance,
    /// How fast it thinks that the ball rolls, in m/s.
    BallSpeed,
    /// Steps that have ended.
    Steps,
    /// How far the capture point is from the middle between the feet, in m.
    Capture,
}

/// The robot to the operator: the values that were chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// What, and its value.
    pub values: [(Internal, f64); 3],
}
