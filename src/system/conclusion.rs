//! What a run comes to: its report, and the error that it returns.

use super::plan::{Plan, Running};
use super::register::Register;
use super::stolen::Stolen;
use super::warnings::Warnings;
use crate::error::{Error, Result};
use crate::log::Shown;
use crate::notice::notice;
use crate::replay::RecordError;
use crate::report::{End, Report};
use crate::safety::{Cause, Emergency};
use crate::time::Witness;
use luna_core::current::ProcessId;
use luna_core::{ProcessState, Standstill};
use luna_platform::clock::Instant;
use std::sync::Arc;

/// What is known of a run after its threads have ended.
pub(super) struct Ended {
    /// Without what the register of processes knows.
    pub(super) report: Report,
    /// Why virtual time stood still, if it did and no emergency came first.
    pub(super) standstill: Option<Standstill>,
    /// The first error of a process before that.
    pub(super) failed_before: Option<Error>,
    pub(super) callback_panic: Option<Error>,
    /// The signal that ended the system.
    pub(super) signal: Option<i32>,
    pub(super) was_emergency: bool,
    pub(super) stolen: Stolen,
    pub(super) running: Arc<Running>,
    /// What viewers see.
    pub(super) shown: Shown,
}

/// Makes the report, which the plan keeps, and gives it or the error of the run. It waits for what
/// records the run, but not once it `is_hurried`.
pub(super) fn conclude(plan: &Plan, ended: Ended, is_hurried: &dyn Fn() -> bool) -> Result<Report> {
    let running = ended.running.clone();
    let (emergency, replay_logs) = (&running.common.emergency, &running.common.replay_logs);
    let mut members = plan.members();
    keep_residents_left_behind(&mut members.started);
    for line in Warnings::rest(&members) {
        notice!("{line}");
    }
    let recorded = replay_logs.finish(is_hurried);
    let started = &members.started;
    let raised = raised_error(started, emergency);
    let end = end_of(&ended, started, raised.is_some());
    let (standstill, signal) = (ended.standstill, ended.signal);
    let stolen = ended.stolen;
    let known = Witness {
        name_of: &|process| started.name(process).map(str::to_owned),
        stolen: &|core, from, until| stolen.between(core, from, until),
    };
    let report = Report {
        end,
        processes: started.reports(),
        earlier: started.earlier(),
        ended_at: (running.common.ended_at)
            .named(&|process| started.name(process).map(str::to_owned)),
        loops: running.common.scope.take_reports(&known),
        stand_ins: plan.stand_ins().replaced(),
        deployment: plan.deployment().map(|deployment| deployment.report()),
        record: recorded.as_ref().ok().copied().flatten(),
        ..ended.report
    };
    ended.shown.ended(&report.end);
    let livelock = livelock(started, standstill, running.common.clock.now());
    if let Some(livelock) = livelock.as_ref().filter(|_| report.end != End::Livelock) {
        // The first cause of the system's end, though a graver error followed.
        notice!("luna: {livelock}");
    }
    let error = match report.end {
        End::Undriven => ended.failed_before,
        End::Livelock => livelock,
        _ => error_of_run(started, raised, &report)
            .or_else(|| ended.callback_panic.filter(|_| signal.is_none()))
            .or_else(|| caught_panic(started, emergency, &report)),
    }
    // For any end of the system: something may not be as its process was to leave it.
    .or_else(|| started.first_cleanup.get().cloned());
    let error = match (error, recorded) {
        // Errors that processes return in a replay that has diverged do not count.
        (_, Err(error @ RecordError::Diverged(_))) => Some(error.into()),
        (None, Err(error)) => Some(error.into()),
        (None, Ok(_)) => replay_logs.outside().map(Error::from),
        (error, _) => error,
    };
    members.report = Some(report.clone());
    match error {
        Some(error) => {
            // A test on a virtual clock asks for it; a machine's operator has nothing else.
            if !report.clock.is_virtual() {
                // The error has the deadlock.
                let deadlock = None;
                let text = Report { deadlock, ..report }.to_string();
                notice!("{}", text.trim_end());
            }
            Err(error)
        }
        None => Ok(report),
    }
}

/// Keeps what the bodies on detached threads refer to, and names those that are not cleaned up.
fn keep_residents_left_behind(started: &mut Register) {
    for left_behind in started.left_behind() {
        if left_behind.handle.state() == ProcessState::Running {
            notice!(
                "luna: process `{}` was still computing or in a blocking call, so its `post_run` does not run",
                left_behind.name()
            );
        }
        // Its body still exists, on the detached thread, and refers to them.
        std::mem::forget(left_behind.resident.take());
    }
}

/// The error that an emergency was raised with, with the process that raised it.
fn raised_error(started: &Register, emergency: &Emergency) -> Option<Error> {
    let (process, cause) = emergency.cause()?;
    let error = match cause {
        Cause::Raised(error) => error,
        Cause::ParentDied | Cause::GuardianLost => Error::other(cause.to_string()),
        _ => return None,
    };
    Some(in_its_process(started, process, error))
}

/// The error, in the process from which it comes, if it comes from one.
fn in_its_process(started: &Register, process: Option<ProcessId>, error: Error) -> Error {
    match process.and_then(|process| started.name(process)) {
        Some(name) => error.in_process(name),
        None => error,
    }
}

/// How the system ended.
fn end_of(ended: &Ended, started: &Register, is_raised: bool) -> End {
    if let Some(number) = ended.signal {
        return End::Signal(number);
    }
    if !ended.was_emergency {
        return match ended.standstill {
            Some(Standstill::Livelock { .. }) => End::Livelock,
            Some(_) => End::Undriven,
            None => End::Completed,
        };
    }
    match started.first_panic.get() {
        _ if is_raised => End::Emergency,
        None if ended.report.deadlock.is_some() && ended.running.ends_at_deadlock() => {
            End::Deadlock
        }
        None if started.overrun().is_some() => End::Overrun,
        _ => End::Panic,
    }
}

/// The livelock that a virtual clock has reached, if any, at `now`.
fn livelock(started: &Register, standstill: Option<Standstill>, now: Instant) -> Option<Error> {
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
fn caught_panic(started: &Register, emergency: &Emergency, report: &Report) -> Option<Error> {
    let (process, _) = emergency.cause().filter(|_| report.end == End::Panic)?;
    let message = "it was caught, but not by `luna::safety::catch_panic`";
    let error = Error::Panicked(message.to_owned());
    Some(in_its_process(started, process, error))
}

/// The error that a run returns if its time did not stand still: a panic's before all others, since
/// it is the cause; none if a signal ended the system, since what processes return while they are
/// being ended does not count.
fn error_of_run(started: &Register, raised: Option<Error>, report: &Report) -> Option<Error> {
    match report.end {
        // Errors that processes return while they are being ended do not count.
        End::Signal(_) | End::Undriven | End::Livelock => None,
        End::Deadlock => report.deadlock.clone().map(Box::new).map(Error::Deadlock),
        End::Overrun => started.overrun(),
        End::Emergency => raised,
        End::Panic => started.first_panic.get().cloned(),
        End::Completed => started.first_error.get().cloned(),
    }
}
