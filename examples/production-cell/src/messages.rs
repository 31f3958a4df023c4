//! What the blocks of a unit, the units and the operator send each other. All is plain data, so
//! that a channel may lead into another program, and encoded for one on another computer.

use crate::parameters::PLACES;
use luna_ipc::ZeroCopySend;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A value that passes between units, or between a unit and the operator.
pub trait Message: ZeroCopySend + Serialize + DeserializeOwned + Copy + Send + 'static {
    /// What the receiver is given when the sender's program has ended; none: nothing.
    fn lost() -> Option<Self> {
        None
    }

    /// The value as the receiver is given it, when it may have been under way for `age`.
    #[must_use]
    fn aged(self, _age: Duration) -> Self {
        self
    }
}

/// How a unit is. The first four are no failure.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Condition {
    /// The operator has not started it.
    #[default]
    Stopped,
    /// It works.
    Running,
    /// Its motor is off, since the unit ahead has failed.
    Halted,
    /// It went to its safe position, since the unit behind has failed.
    Safe,
    /// It has a fault itself; its motor is off.
    Faulty,
    /// Nothing is heard of it.
    Lost,
}

/// The names of conditions, as the scope reads them.
pub(crate) const CONDITIONS: &str = "0 stopped; 1 running; 2 halted; 3 safe; 4 faulty; 5 lost";

impl Condition {
    /// Whether a neighbour has to heed it.
    pub fn is_failed(self) -> bool {
        matches!(self, Condition::Faulty | Condition::Lost)
    }
}

/// A unit to its neighbours.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend, Serialize, Deserialize)]
pub struct Status {
    /// How it is.
    pub condition: Condition,
    /// Blocks up to this number may come from behind: those that it has taken, and one more if it
    /// is ready. So a status that is late never lets a second block through.
    pub accepts: u32,
    /// How old it may be when it arrives, in µs. A unit says 0. A link between hosts says how long
    /// it was under way: a network may deliver what a unit said long before it died.
    pub age: u32,
}

impl Message for Status {
    fn lost() -> Option<Self> {
        let condition = Condition::Lost;
        Some(Self {
            condition,
            ..Self::default()
        })
    }

    fn aged(self, age: Duration) -> Self {
        let age = u32::try_from(age.as_micros()).unwrap_or(u32::MAX);
        Self { age, ..self }
    }
}

/// A block passes from a unit to the next.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend, Serialize, Deserialize)]
pub struct Handed {
    /// Of the hand-over between these two units, from 1. One that is offered again, since its
    /// acknowledgement was lost with a program, is known by it.
    pub number: u32,
    /// The block.
    pub block: u32,
}

impl Message for Handed {}

/// A fault that the simulation makes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend, Serialize, Deserialize)]
pub enum Fault {
    /// None.
    #[default]
    None,
    /// The axis does not move.
    Stuck,
    /// The position sensor's wire is broken.
    Sensor,
    /// The unit is dead, as if its program were killed: it does nothing, says nothing, and takes
    /// nothing.
    Dead,
}

/// The operator to a unit's command block.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend, Serialize, Deserialize)]
pub struct Request {
    /// Whether the line is to run.
    pub run: bool,
    /// Whether the unit's processes are to end.
    pub end: bool,
    /// Which of the control laws is to work.
    pub law: u8,
    /// Counts the repairs: a new number lets the safety block judge anew.
    pub repairs: u32,
    /// What the simulated mechanics are to suffer from.
    pub fault: Fault,
}

impl Message for Request {
    fn lost() -> Option<Self> {
        let end = true;
        Some(Self {
            end,
            ..Self::default()
        })
    }
}

/// A unit to the operator.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend, Serialize, Deserialize)]
pub struct Report {
    /// How it is.
    pub condition: Condition,
    /// It runs, and has nothing to do until a neighbour is ready.
    pub waits: bool,
    /// The control law that works.
    pub law: u8,
    /// Where its axis is, in m.
    pub position: f64,
    /// What its mechanics hold.
    pub contents: Contents,
}

impl Message for Report {
    fn lost() -> Option<Self> {
        let condition = Condition::Lost;
        Some(Self {
            condition,
            ..Self::default()
        })
    }
}

/// What a unit's mechanics hold: the simulation's own view, which no real unit has.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend, Serialize, Deserialize)]
pub struct Contents {
    /// The blocks; 0 for none.
    pub blocks: [u32; PLACES],
    /// Whether one is being handed over.
    pub under_way: bool,
    /// Blocks taken so far.
    pub taken: u32,
    /// Blocks given so far.
    pub given: u32,
    /// Collisions so far.
    pub collisions: u32,
}

/// What a unit's sensors read.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sensors {
    /// Of the axis, in m.
    pub position: f64,
    /// Of a belt: a block is at its entry. Of an arm: it holds one.
    pub entry: bool,
    /// Of a belt: a block is at its exit. Of an arm: it holds one.
    pub exit: bool,
    /// Blocks counted in so far.
    pub taken: u32,
    /// Blocks counted out so far.
    pub given: u32,
    /// Blocks here.
    pub count: u32,
}

/// What drives a unit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Drive {
    /// Of the motor, -1 to 1.
    pub duty: f64,
    /// Whether an arm lets go of its block.
    pub release: bool,
}

/// What a controller is to reach.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Goal {
    /// This position, in m.
    Position(f64),
    /// This speed, in m/s.
    Speed(f64),
}

/// A command block to its safety block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Order {
    /// Whether the operator has started the unit.
    pub run: bool,
    /// What the controller is to reach.
    pub goal: Goal,
    /// Whether an arm is to let go of its block.
    pub release: bool,
    /// Whether a block may come.
    pub ready: bool,
    /// Which of the control laws is to work.
    pub law: u8,
    /// See [`Request::repairs`].
    pub repairs: u32,
}

impl Default for Order {
    fn default() -> Self {
        Self {
            run: false,
            goal: Goal::Speed(0.0),
            release: false,
            ready: false,
            law: 0,
            repairs: 0,
        }
    }
}

/// A safety block to its controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// What is to be reached.
    pub goal: Goal,
    /// Which of the control laws is to work.
    pub law: u8,
}

/// A safety block to its command block.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct View {
    /// What the sensors read; of a broken one, the last good reading.
    pub sensors: Sensors,
    /// How the unit is.
    pub condition: Condition,
    /// Blocks up to this number may go to the unit ahead; 0 if it has failed.
    pub ahead_accepts: u32,
}
