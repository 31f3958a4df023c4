//! What ends a link.

use crate::Actuator;
use hostmot2::encoder::Lost;
use luna::FileError;
use std::fmt;

/// Why a link has ended. It is the cause of the emergency that it has raised ([`luna::emergency`]).
///
/// Found in [`Error::Other`](luna::Error::Other) of what [`System::run`](luna::System::run) returns. After each of them the card's outputs are off.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Fault {
    /// Too many answers did not come in time, or too many write packets got lost.
    TooManyErrors {
        /// The cycles in a row without an answer.
        in_a_row: u32,
    },
    /// The card's watchdog has bitten: no write packet had come for its time.
    Bitten,
    /// The card was restarted, or somebody else writes to it.
    Foreign,
    /// A position is lost.
    Encoder {
        /// Of which encoder.
        encoder: usize,
        /// Why.
        why: Lost,
    },
    /// Who writes to an actuator has not gone, but writes no more: it hangs.
    Overdue {
        /// To which.
        actuator: Actuator,
        /// The cycles in which no new set-point has come.
        cycles: u32,
    },
    /// The socket cannot be waited for.
    Wait(FileError),
    /// The system runs on a virtual clock; a card has its own, real time.
    VirtualTime,
    /// The process was run a second time.
    RunTwice,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Fault::TooManyErrors { in_a_row: 0 } => {
                f.write_str("too many packets to or from the card were lost")
            }
            Fault::TooManyErrors { in_a_row } => write!(
                f,
                "too many answers of the card did not come in time, {in_a_row} in a row at last: look at its power and cable"
            ),
            Fault::Bitten => f.write_str(
                "the card's watchdog has bitten: its outputs are off, since no packet had come for its time",
            ),
            Fault::Foreign => {
                f.write_str("the card was restarted, or somebody else writes to it")
            }
            Fault::Encoder { encoder, why } => write!(f, "encoder {encoder}: {why}"),
            Fault::Overdue { actuator, cycles } => write!(
                f,
                "no set-point for {actuator} has come in {cycles} cycles: who writes it hangs; if it is set once, give it no greatest age"
            ),
            Fault::Wait(error) => error.fmt(f),
            Fault::VirtualTime => f.write_str(
                "the system is on a virtual clock, which the card does not know: simulate the machine instead",
            ),
            Fault::RunTwice => f.write_str("a link runs once: make another one"),
        }
    }
}

impl std::error::Error for Fault {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Fault::Encoder { why, .. } => Some(why),
            Fault::Wait(error) => Some(error),
            _ => None,
        }
    }
}
