//! What ends a link.

use crate::{Place, State};
use luna::external::FileError;
use std::time::Duration;

/// Why a link has ended. It is the cause of the emergency that the link has raised
/// ([`luna::emergency`]).
///
/// It is the source in [`Error::Other`](luna::Error::Other), returned by
/// [`System::run`](luna::System::run). After each of them the outputs have their safe values, and
/// the bus is in SAFE-OP, if it still gets frames.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// Too many cycles had no answer in time, or a wrong working counter.
    #[error("{}", too_many_errors(*in_a_row, *silent))]
    TooManyErrors {
        /// The failed cycles in a row.
        in_a_row: u32,
        /// The first subdevice that did not answer in the last of them, if frames came back.
        silent: Option<usize>,
    },
    /// A subdevice has left the operational state by itself.
    #[error("the subdevice at position {position} has left OP: it is in {state}, {}", code_text(*code))]
    Left {
        /// From 0.
        position: usize,
        /// Where it is now.
        state: State,
        /// Its reason, an AL status code; none if it did not answer.
        code: Option<u16>,
    },
    /// A subdevice did not become operational in time.
    #[error(
        "the subdevice at position {position} did not reach OP within {within:?}: it is in {state}, {}",
        code_text(*code)
    )]
    NotOperational {
        /// From 0.
        position: usize,
        /// Where it is.
        state: State,
        /// Its reason, an AL status code; none if it did not answer.
        code: Option<u16>,
        /// How long it had.
        within: Duration,
    },
    /// The loop was not in step with the reference clock in time.
    #[error(
        "the loop was not in step with the reference clock within {within:?}: the phase error is {phase_error} ns at last; give it a greater tolerance, or less lateness"
    )]
    NotLocked {
        /// By how much the loop's slot came after the clock's (ns).
        phase_error: i64,
        /// How long it had.
        within: Duration,
    },
    /// The writer of an output exists, but sends nothing any more: it hangs.
    #[error(
        "no set-point for the {place} has come in {cycles} cycles: its writer hangs; if it is set once, give it no greatest age"
    )]
    Overdue {
        /// Which.
        place: Place,
        /// The cycles without a new set-point.
        cycles: u32,
    },
    /// The system's file has given the loop another period than SYNC0 has.
    #[error(
        "the loop's period is {given:?}, and SYNC0 has {configured:?}: change both in the program"
    )]
    Period {
        /// What the bus was set up with.
        configured: Duration,
        /// What the loop has.
        given: Duration,
    },
    /// The network interface cannot be waited for.
    #[error("{0}")]
    Wait(#[source] FileError),
    /// The system runs on a virtual clock; subdevices have their own, real time.
    #[error(
        "the system is on a virtual clock, which real subdevices do not know: use simulated ones"
    )]
    VirtualTime,
    /// The process was run a second time.
    #[error("a link runs once: make another one")]
    RunTwice,
}

fn too_many_errors(in_a_row: u32, silent: Option<usize>) -> String {
    match silent {
        Some(position) => format!(
            "the subdevice at position {position} does not answer, for {in_a_row} cycles in a row at last: check its power and the cable before it"
        ),
        None => format!(
            "too many frames were lost or had a wrong working counter, {in_a_row} in a row at last: check power and cables"
        ),
    }
}

fn code_text(code: Option<u16>) -> String {
    match code {
        Some(code) => format!("with AL status code {code:#06x}"),
        None => "and does not tell why".to_owned(),
    }
}
