//! What a run comes to: its report, and the error that it returns.

use super::register::Register;
use super::stolen::Stolen;
use crate::error::Error;
use crate::report::{End, Report};
use crate::safety::Emergency;
use crate::time::{StolenTime, Witness};
use luna_core::current::ProcessId;
use luna_executors::Standstill;
use luna_platform::clock::Instant;

/// What the report needs to explain why cycles were late.
pub(super) struct Known<'a> {
    pub(super) started: &'a Register,
    pub(super) stolen: Stolen,
}

impl Witness for Known<'_> {
    fn name_of(&self, process: ProcessId) -> Option<String> {
        self.started.name(process).map(str::to_owned)
    }

    fn stolen(&self, core: usize, from: Instant, until: Instant) -> Option<StolenTime> {
        self.stolen.between(core, from, until)
    }
}

/// The livelock that a virtual clock has reached, if any, at `now`.
pub(super) fn livelock(
    started: &Register,
    standstill: Option<Standstill>,
    now: Instant,
) -> Option<Error> {
    match standstill? {
        Standstill::Livelock { process, turns } => Some(Error::Livelock {
            process: started.name(process).unwrap_or_default().to_owned(),
            turns,
            at: now,
        }),
        _ => None,
    }
}

/// The error of a run that a panic has ended without ending a process: it was an emergency before
/// the body caught it.
pub(super) fn caught_panic(
    started: &Register,
    emergency: &Emergency,
    report: &Report,
) -> Option<Error> {
    let (process, _) = emergency.cause().filter(|_| report.end == End::Panic)?;
    let message = "it was caught, but not by `luna::catch_panic`";
    let error = Error::Panicked(message.to_owned());
    match process.and_then(|process| started.name(process)) {
        Some(name) => Some(error.in_process(name)),
        None => Some(error),
    }
}

/// The error that a run returns if its time did not stand still: a panic's before all others, since
/// it is the cause; none if a signal ended the system, since what processes return while they are
/// being ended does not count.
pub(super) fn error_of_run(
    started: &Register,
    cause: Option<Error>,
    report: &Report,
) -> Option<Error> {
    match report.end {
        // Errors that processes return while they are being ended do not count.
        End::Signal(_) | End::Undriven | End::Livelock => None,
        End::Deadlock => report.deadlock.clone().map(Box::new).map(Error::Deadlock),
        End::Overrun | End::Emergency => cause,
        End::Panic => started.first_panic().cloned(),
        End::Completed => started.first_error().cloned(),
    }
}
