//! What ends a link.

use crate::{Place, State};
use luna::external::FileError;
use std::time::Duration;

/// Why a link has ended. A bus that was opened by [`open`](crate::open()) is lost by it: an
/// emergency, unless [`Device::on_loss`](luna::devices::Device::on_loss) says otherwise. One that
/// was opened by [`Bus::open`](crate::Bus::open) raises an emergency ([`luna::emergency`]).
///
/// It is the source in [`Error::Other`](luna::Error::Other). After each of them the outputs have their safe values, and
/// the bus is in SAFE-OP, if it still gets frames.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// Too many cycles had no answer in time, or a wrong working counter.
    #[error(
        "too many cycles failed, {in_a_row} in a row at last: {}",
        too_many_errors(*missed, *miscounted, *counter, *expected, *silent)
    )]
    TooManyErrors {
        /// The failed cycles in a row.
        in_a_row: u32,
        /// The cycles without an answer in time, since failures were last outweighed by good
        /// cycles ([`Link::tolerate`](crate::Link::tolerate)).
        missed: u32,
        /// The cycles with a wrong working counter since then.
        miscounted: u32,
        /// The working counter in the last of these.
        counter: Option<u16>,
        /// What it is if all subdevices take part.
        expected: u16,
        /// The first subdevice that did not answer in the last of these.
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
    /// A subdevice refused to become operational, or was not so in time.
    #[error(
        "the subdevice at position {position} was not in OP after {after:?}: it is in {state}, {}",
        code_text(*code)
    )]
    NotOperational {
        /// From 0.
        position: usize,
        /// Where it is.
        state: State,
        /// Its reason, an AL status code; none if it did not answer.
        code: Option<u16>,
        /// The time since the first cycle.
        after: Duration,
    },
    /// All subdevices are in OP, and one did not take part in process data in time.
    #[error(
        "the working counter was {counter} instead of {expected} for {within:?}: all subdevices are in OP, and one takes no part in the process data"
    )]
    Miscounted {
        /// The last one.
        counter: u16,
        /// What it is if all subdevices take part.
        expected: u16,
        /// How long they had.
        within: Duration,
    },
    /// The loop was not in step with the reference clock in time.
    #[error(
        "the loop was not in step with the reference clock within {within:?}: {}",
        not_locked(*phase_error, *refused)
    )]
    NotLocked {
        /// By how much the loop's last measured slot came after the clock's (ns); none if none was
        /// measured.
        phase_error: Option<i64>,
        /// How often the clock's time was not used, since its frame was under way for too long
        /// ([`Link::clock_tolerance`](crate::Link::clock_tolerance)).
        refused: u64,
        /// How long it had.
        within: Duration,
    },
    /// The writer of an output exists, but sends nothing any more.
    #[error(
        "no set-point for the {place} has come in {cycles} cycles, and its writer has not ended; if it is set once, give it no greatest age"
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
    /// The system's file has given the loop a period for which a setting is invalid.
    #[error("the system's file gives the loop a period of {given:?}: {why}")]
    Setting {
        /// What the loop has.
        given: Duration,
        /// What is invalid.
        why: &'static str,
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

fn too_many_errors(
    missed: u32,
    miscounted: u32,
    counter: Option<u16>,
    expected: u16,
    silent: Option<usize>,
) -> String {
    let counts = match counter {
        Some(counter) => format!(
            "{missed} had no answer in time, {miscounted} a wrong working counter, {counter} instead of {expected} at last"
        ),
        None => format!("{missed} had no answer in time"),
    };
    match (counter, silent) {
        (_, Some(position)) => format!(
            "{counts}; the subdevice at position {position} did not answer then: check its power and the cable before it"
        ),
        (Some(_), None) => {
            format!("{counts}; all subdevices answered then, and one took no part in process data")
        }
        (None, None) => format!(
            "{counts}; check the cable to the first subdevice, and whether this computer sends and receives in time"
        ),
    }
}

fn not_locked(phase_error: Option<i64>, refused: u64) -> String {
    let measured = match phase_error {
        Some(error) => format!("the phase error is {error} ns at last"),
        None => "no phase error was measured".to_owned(),
    };
    format!(
        "{measured}, and {refused} readings were not used since their frames were under way for too long; give it a greater tolerance, or less lateness"
    )
}

fn code_text(code: Option<u16>) -> String {
    match code {
        Some(code) => format!("with AL status code {code:#06x}"),
        None => "and gives no reason".to_owned(),
    }
}
