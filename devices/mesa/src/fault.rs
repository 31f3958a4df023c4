//! What ends a link.

use crate::Actuator;
use hostmot2::encoder::Lost;
use luna::external::FileError;

/// Why a link has ended. It is the cause of the emergency that the link has raised
/// ([`luna::emergency`]).
///
/// It is the source in [`Error::Other`](luna::Error::Other), returned by
/// [`System::run`](luna::System::run). After each of them the card's outputs are off.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// Too many answers did not come in time, or too many write packets were lost.
    #[error("{}", too_many_errors(*in_a_row))]
    TooManyErrors {
        /// The cycles in a row without an answer.
        in_a_row: u32,
    },
    /// The card's watchdog has expired: no write packet had come for its time.
    #[error(
        "the card's watchdog has expired: its outputs are off, since no packet had come for its time"
    )]
    Bitten,
    /// The card was restarted, or another program writes to it.
    #[error("the card was restarted, or another program writes to it")]
    Foreign,
    /// A position is lost.
    #[error("encoder {encoder}: {why}")]
    Encoder {
        /// Of which encoder.
        encoder: usize,
        /// Why.
        #[source]
        why: Lost,
    },
    /// The writer of an actuator exists, and has sent nothing for longer than the greatest age.
    #[error(
        "no set-point for {actuator} has come in {cycles} cycles, and its writer has not ended; if it is set once, give it no greatest age"
    )]
    Overdue {
        /// To which.
        actuator: Actuator,
        /// The cycles without a new set-point.
        cycles: u32,
    },
    /// The socket cannot be waited for.
    #[error("{0}")]
    Wait(#[source] FileError),
    /// The system runs on a virtual clock; a card has its own, real time.
    #[error(
        "the system is on a virtual clock, which the card does not know: simulate the machine instead"
    )]
    VirtualTime,
    /// The process was run a second time.
    #[error("a link runs once: make another one")]
    RunTwice,
}

fn too_many_errors(in_a_row: u32) -> String {
    match in_a_row {
        0 => "too many packets to or from the card were lost".to_owned(),
        _ => format!(
            "too many answers of the card did not come in time, {in_a_row} in a row at last: check its power and cable"
        ),
    }
}
