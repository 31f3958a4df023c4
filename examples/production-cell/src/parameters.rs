//! The six units, and all figures that are chosen for them. Lengths in m, times in s, speeds in
//! m/s.

use serde::Serialize;
use std::time::Duration;

/// From one cycle of a controller to the next: 1 kHz.
pub const PERIOD: Duration = Duration::from_millis(1);
/// [`PERIOD`] in s.
pub const DT: f64 = 1e-3;
/// So many cycles of the safety block are one step of the command block: 200 Hz.
pub const CYCLES_OF_COMMAND: u32 = 5;
/// So many cycles at most between two status messages to a neighbour.
pub const CYCLES_OF_STATUS: u32 = 10;
/// A neighbour that is not heard for this time counts as lost.
pub const NEIGHBOUR_TIMEOUT: Duration = Duration::from_millis(100);
/// A unit that the operator does not hear for this time is shown as lost.
pub const OPERATOR_TIMEOUT: Duration = Duration::from_millis(150);

/// The time constant of a motor with its load.
pub const MOTOR_TIME: f64 = 0.02;
/// A motor's speed at full duty, as a factor of the unit's working speed.
pub const RESERVE: f64 = 1.25;
/// How near an arm has to be to the place where it takes or gives.
pub const REACH: f64 = 5e-3;
/// The length of a block.
pub const BLOCK: f64 = 0.05;
/// A belt's entry is free if the newest block has gone this far.
pub const ENTRY: f64 = 0.09;
/// A belt's exit sensor, before its end. A belt stops within less.
pub const EXIT: f64 = 0.03;
/// A block may stand out so far beyond a belt's end before it hits what is there. A belt at full
/// speed halts within it when a neighbour dies: timeout times speed, and the motor's time.
pub const OVERHANG: f64 = 0.04;
/// The most blocks in one unit.
pub const PLACES: usize = 8;

/// A position sensor reads within this, in either direction.
pub const POSITION_RANGE: f64 = 1e4;
/// What a broken position sensor reads: its wire touches the supply.
pub const BROKEN_READING: f64 = 9e9;
/// A motor with at least this duty moves its axis ...
pub const DRIVEN: f64 = 0.3;
/// ... by this distance ...
pub const MOVED: f64 = 1e-3;
/// ... within this time, or it is stuck.
pub const STUCK_AFTER: Duration = Duration::from_millis(60);

/// A unit of the cell, in the direction of the blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Unit {
    /// Carries blocks from the robot to the feeder.
    FeederBelt,
    /// Pushes a block into the moulder.
    Feeder,
    /// Keeps the moulder closed while a block is moulded, and opens it.
    MoulderDoor,
    /// Lifts the block out of the moulder, onto the belt.
    Extractor,
    /// Carries blocks from the extractor to the robot.
    ExtractionBelt,
    /// Carries a block back to the feeder belt.
    Robot,
}

impl Unit {
    /// All, in the direction of the blocks.
    pub const ALL: [Unit; 6] = [
        Unit::FeederBelt,
        Unit::Feeder,
        Unit::MoulderDoor,
        Unit::Extractor,
        Unit::ExtractionBelt,
        Unit::Robot,
    ];

    /// Its name, in channels, reports and on the command line.
    pub fn name(self) -> &'static str {
        [
            "feeder-belt",
            "feeder",
            "moulder-door",
            "extractor",
            "extraction-belt",
            "robot",
        ][self as usize]
    }

    /// The unit of this name.
    pub fn named(name: &str) -> Option<Unit> {
        Self::ALL.into_iter().find(|unit| unit.name() == name)
    }

    /// The unit that it gives blocks to.
    pub fn ahead(self) -> Unit {
        Self::ALL[(self as usize + 1) % 6]
    }

    /// The unit that it takes blocks from.
    pub fn behind(self) -> Unit {
        Self::ALL[(self as usize + 5) % 6]
    }

    /// Its figures.
    pub fn parameters(self) -> &'static Parameters {
        &PARAMETERS[self as usize]
    }
}

/// How a unit carries blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A belt with several blocks. It hands over a block that passes its end.
    Belt,
    /// An axis with one place. It hands over the block that it releases.
    Arm,
}

/// The figures of a unit.
#[derive(Debug, Clone, Copy)]
pub struct Parameters {
    /// How it carries blocks.
    pub kind: Kind,
    /// Where it takes a block: of a belt, its begin.
    pub take: f64,
    /// Where it gives it: of a belt, its end.
    pub give: f64,
    /// Its working speed.
    pub speed: f64,
    /// How long it keeps a block before it carries it, in s.
    pub work: f64,
    /// Where it goes if the unit behind it fails; none: it goes on with what it has.
    pub safe: Option<f64>,
    /// Where on it blocks lie at first.
    pub blocks: &'static [f64],
}

impl Parameters {
    const fn new(kind: Kind, give: f64, speed: f64) -> Self {
        Self {
            kind,
            take: 0.0,
            give,
            speed,
            work: 0.0,
            safe: None,
            blocks: &[],
        }
    }
}

const PARAMETERS: [Parameters; 6] = [
    Parameters {
        blocks: &[0.36, 0.26, 0.16],
        ..Parameters::new(Kind::Belt, 0.4, 0.25)
    },
    Parameters::new(Kind::Arm, 0.15, 0.5),
    Parameters {
        work: 0.3,
        safe: Some(0.1),
        ..Parameters::new(Kind::Arm, 0.1, 0.5)
    },
    Parameters::new(Kind::Arm, 0.2, 0.7),
    Parameters {
        blocks: &[0.3, 0.2],
        ..Parameters::new(Kind::Belt, 0.4, 0.25)
    },
    Parameters::new(Kind::Arm, 0.3, 0.8),
];

/// How many blocks there are. Their names are 1, 2, ...
pub const BLOCKS: usize = {
    let (mut blocks, mut unit) = (0, 0);
    while unit < PARAMETERS.len() {
        blocks += PARAMETERS[unit].blocks.len();
        unit += 1;
    }
    blocks
};

/// The name of the first block on a unit.
pub fn first_block(unit: Unit) -> u32 {
    let before = &PARAMETERS[..unit as usize];
    1 + before
        .iter()
        .map(|other| other.blocks.len() as u32)
        .sum::<u32>()
}
