//! The clock of a system: the machine's, or one of its own.

use crate::error::{Error, Result};
use luna_executors::{DrivenClock, Pace, ProcessRegistry, Simulation};
use std::fmt;
use std::sync::Arc;

/// How many turns are taken at one instant of a virtual clock before that is called a livelock, if
/// not stated.
const MAX_TURNS: u64 = 1_000_000_000;

/// The clock that a system is to go by.
#[derive(Debug, Default)]
pub(crate) enum ClockPlan {
    #[default]
    Real,
    Virtual,
    Driven(DrivenClock),
}

impl ClockPlan {
    pub(crate) fn kind(&self) -> ClockKind {
        match self {
            ClockPlan::Real => ClockKind::Real,
            ClockPlan::Virtual => ClockKind::Virtual,
            ClockPlan::Driven(_) => ClockKind::Driven,
        }
    }

    /// Starts what runs the processes, unless that is threads of their own.
    pub(super) fn start(
        self,
        registry: &Arc<ProcessRegistry>,
        most_turns: Option<u64>,
    ) -> Result<Option<Simulation>> {
        let pace = match self {
            ClockPlan::Real => return Ok(None),
            ClockPlan::Virtual => Pace::Jumping,
            ClockPlan::Driven(clock) => Pace::Driven(clock),
        };
        Simulation::start(pace, registry.clone(), most_turns.unwrap_or(MAX_TURNS))
            .map(Some)
            .map_err(|error| Error::not_started("the virtual clock", error))
    }
}

/// The clock of a system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum ClockKind {
    /// The machine's.
    #[default]
    Real,
    /// One that jumps to the next deadline when no process can run:
    /// [`System::virtual_clock`](crate::System::virtual_clock).
    Virtual,
    /// One that a simulator moves: [`System::driven_clock`](crate::System::driven_clock).
    Driven,
}

impl ClockKind {
    /// Whether its time is not the machine's.
    pub fn is_virtual(self) -> bool {
        self != ClockKind::Real
    }
}

impl fmt::Display for ClockKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ClockKind::Real => "real",
            ClockKind::Virtual => "virtual",
            ClockKind::Driven => "driven",
        })
    }
}
