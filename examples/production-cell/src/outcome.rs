//! What became of a run.

use crate::messages::{Condition, Report};
use crate::operator::{Change, Log, Mark};
use crate::parameters::Unit;
use serde::Serialize;

/// What became of a run.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Rounds that blocks have completed: blocks that the robot has given to the feeder belt.
    pub blocks: u32,
    /// Blocks that are nowhere at the end.
    pub lost: u32,
    /// Blocks that are in more than one place at the end.
    pub doubled: u32,
    /// Collisions that the mechanics have seen.
    pub collisions: u32,
    /// Whether all units came to rest when the line was stopped: else the counts say nothing.
    pub at_rest: bool,
    /// In s, from the start of the line to its rest.
    pub seconds: f64,
    /// The units, in the direction of the blocks.
    pub units: Vec<UnitOutcome>,
    /// What the operator did.
    pub marks: Vec<Mark>,
    /// The time line.
    #[serde(skip)]
    pub changes: Vec<Change>,
}

/// What became of a unit.
#[derive(Debug, Clone, Serialize)]
pub struct UnitOutcome {
    /// Which.
    pub name: Unit,
    /// How it was at the end.
    pub condition: Condition,
    /// Blocks that it has taken.
    pub taken: u32,
    /// Blocks that it has given.
    pub given: u32,
    /// Its blocks at the end.
    pub blocks: Vec<u32>,
    /// Collisions in it.
    pub collisions: u32,
    /// How often it halted, or went to its safe position, for a neighbour's failure.
    pub stops: usize,
}

impl Outcome {
    pub(crate) fn of(log: Log) -> Self {
        let (lost, doubled) = log.lost_and_doubled();
        let report = |unit: Unit| log.last[unit as usize].unwrap_or_default();
        let units = Unit::ALL.map(|unit| {
            let Report {
                condition,
                contents,
                ..
            } = report(unit);
            let is_stop = |change: &&Change| {
                change.unit == unit
                    && matches!(change.seen.condition, Condition::Halted | Condition::Safe)
            };
            UnitOutcome {
                name: unit,
                condition,
                taken: contents.taken,
                given: contents.given,
                blocks: contents
                    .blocks
                    .into_iter()
                    .filter(|block| *block != 0)
                    .collect(),
                collisions: contents.collisions,
                stops: log.changes.iter().filter(is_stop).count(),
            }
        });
        Self {
            blocks: report(Unit::FeederBelt).contents.taken,
            lost,
            doubled,
            collisions: units.iter().map(|unit| unit.collisions).sum(),
            at_rest: log.is_at_rest,
            seconds: log.seconds,
            units: units.into(),
            marks: log.marks,
            changes: log.changes,
        }
    }

    /// Whether blocks moved, none was lost or doubled, and nothing collided.
    pub fn is_good(&self) -> bool {
        let has_moved = self.units.iter().any(|unit| unit.given > 0);
        self.at_rest && has_moved && self.lost + self.doubled + self.collisions == 0
    }

    /// Whether `unit` was seen in this condition at some time.
    pub fn was(&self, unit: Unit, condition: Condition) -> bool {
        let mut changes = self.changes.iter();
        changes.any(|change| change.unit == unit && change.seen.condition == condition)
    }
}
