//! What the modules send each other. All is plain data without references.

use crate::legs::Side;
use crate::parameters::JOINTS;
use luna::external::{FromBytes, Malformed, ToBytes};
use luna_links::cycle::CycleData;
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

impl Internal {
    /// All, each at its number in a message.
    pub const ALL: [Internal; 4] = [
        Internal::BallDistance,
        Internal::BallSpeed,
        Internal::Steps,
        Internal::Capture,
    ];

    fn of(number: u8) -> Result<Self, Malformed> {
        let value = Self::ALL.get(usize::from(number)).copied();
        value.ok_or(Malformed("there is no internal value of this number"))
    }
}

/// The robot to the operator: the values that were chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// When, by the robot: since its start, in s.
    pub time: f64,
    /// What, and its value.
    pub values: [(Internal, f64); 3],
}

// How they cross to another computer.
luna_links::cycle_data! {
    struct PackedRequest: "tulip/request", version 1 { walk: u8, law: u8, show: [u8; 3] }
}
luna_links::cycle_data! {
    struct PackedShown: "tulip/shown", version 1 { time: f64, what: [u8; 3], values: [f64; 3] }
}

/// The bytes of the longer of both messages.
pub(crate) const LONGEST: usize = PackedShown::SIZE;

impl Request {
    fn packed(&self) -> PackedRequest {
        PackedRequest {
            walk: u8::from(self.walk),
            law: self.law,
            show: self.show.map(|what| what as u8),
        }
    }
}

impl Shown {
    fn packed(&self) -> PackedShown {
        PackedShown {
            time: self.time,
            what: self.values.map(|(what, _)| what as u8),
            values: self.values.map(|(_, value)| value),
        }
    }
}

impl ToBytes for Request {
    fn length(&self) -> usize {
        PackedRequest::SIZE
    }

    fn to_bytes(&self, to: &mut [u8]) {
        self.packed().to_bytes(to);
    }
}

impl FromBytes for Request {
    fn from_bytes(bytes: &[u8]) -> Result<Self, Malformed> {
        let PackedRequest { walk, law, show } = PackedRequest::from_bytes(bytes)?;
        let [a, b, c] = show;
        Ok(Self {
            walk: walk != 0,
            law,
            show: [Internal::of(a)?, Internal::of(b)?, Internal::of(c)?],
        })
    }
}

impl ToBytes for Shown {
    fn length(&self) -> usize {
        PackedShown::SIZE
    }

    fn to_bytes(&self, to: &mut [u8]) {
        self.packed().to_bytes(to);
    }
}

impl FromBytes for Shown {
    fn from_bytes(bytes: &[u8]) -> Result<Self, Malformed> {
        let packed = PackedShown::from_bytes(bytes)?;
        let [a, b, c] = packed.what;
        let [x, y, z] = packed.values;
        Ok(Self {
            time: packed.time,
            values: [
                (Internal::of(a)?, x),
                (Internal::of(b)?, y),
                (Internal::of(c)?, z),
            ],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_crosses_to_the_operator_and_back_is_the_same() {
        let request = Request {
            walk: true,
            law: 1,
            show: [Internal::Capture, Internal::BallSpeed, Internal::Steps],
        };
        let shown = Shown {
            time: 2.5,
            values: [
                (Internal::BallDistance, 1.25),
                (Internal::Steps, 7.0),
                (Internal::Capture, -0.5),
            ],
        };
        let mut bytes = [0; LONGEST];
        let to = &mut bytes[..request.length()];
        request.to_bytes(to);
        assert_eq!(Request::from_bytes(to), Ok(request));
        to[4] = Internal::ALL.len() as u8;
        assert!(Request::from_bytes(to).is_err());
        shown.to_bytes(&mut bytes);
        assert_eq!(Shown::from_bytes(&bytes), Ok(shown));
        for (number, what) in Internal::ALL.into_iter().enumerate() {
            assert_eq!(what as usize, number);
        }
    }
}
