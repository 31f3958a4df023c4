//! The run: from the release of the bodies to the report.

use super::deadlock::Deadlock;
use super::launch::{Launched, launch};
use super::plan::{Member, NamedThread, Phase, Plan};
use super::quiet::Lookout;
use super::stolen::Stolen;
use super::warnings::Warnings;
use crate::csp::process::{Ended, clean_up};
use crate::error::{Error, Result, SetupError};
use crate::report::{End, ProcessReport, Report, ThreadReport};
use crate::time::Witness;
use luna_executors::{Executor, Exit, ProcessState};
use luna_platform::clock::Instant;
use luna_platform::current::ProcessId;
use luna_platform::thread::{Mode, Obtained, Policy};
use luna_platform::{current, reclaim};
use std::collections::HashMap;
use std::time::Duration;

/// How long the end of a system waits for threads that do not end.
const GRACE: Duration = Duration::from_secs(2);

/// See [`System::run`](crate::System::run).
pub(super) fn run(plan: &Plan) -> Result<Report> {
    if current::home().is_some() {
        return Err(SetupError::Nested.into());
    }
    let launched = launch(plan)?;
    announce_shortfalls(plan, &launched);

    let started = launched.running.scope.begin();
    // What an emergency has brought to safety before the start is not set in motion.
    if !launched.running.emergency.has_begun() {
        for (_, executor) in &launched.executors {
            executor.release();
        }
        for (_, thread) in &plan.members().threads {
            thread.release();
        }
    }

    let mut stolen = Stolen::begin();
    let (threads, deadlock) = watch(plan, &launched, &mut stolen);
    let emergency = launched.running.emergency.is_safe();
    let elapsed = Instant::now() - started;
    let Launched {
        executors,
        running,
        emergency: guard,
        shortfalls,
        ..
    } = launched;
    let threads = end_threads(plan, executors, threads);
    bury(plan, false);
    let signal = guard.stop();
    stolen.sample();

    let mut members = plan.members();
    for left_behind in members.started.iter_mut().filter(|member| !member.buried) {
        if left_behind.handle.state() == ProcessState::Running {
            eprintln!(
                "luna: process `{}` was still computing or in a blocking call, so its `post_run` does not run",
                left_behind.name
            );
        }
        // Its body still lives, on the thread that was left to itself, and borrows it.
        std::mem::forget(left_behind.resident.take());
    }
    for line in Warnings::rest(&members) {
        eprintln!("{line}");
    }
    let processes = members.started.iter().map(process_report).collect();
    let names = members.started.iter();
    let known = Known {
        names: names.map(|one| (one.id, one.name.clone())).collect(),
        stolen,
    };
    let report = Report {
        system: plan.name().to_owned(),
        end: match (signal, emergency, has_panicked(&members.started)) {
            (Some(number), _, _) => End::Signal(number),
            (None, true, false) if deadlock.is_some() && running.mode == Mode::Strict => {
                End::Deadlock
            }
            (None, true, false) if overrun_of(&members.started).is_some() => End::Overrun,
            (None, true, _) => End::Panic,
            (None, false, _) => End::Completed,
        },
        elapsed,
        threads,
        processes,
        loops: running.scope.take_reports(&known),
        shortfalls,
        deadlock,
    };
    members.report = Some(report.clone());
    match first_error(&members.started, &report) {
        Some(error) => Err(error),
        None => Ok(report),
    }
}

/// Says once what is done without.
fn announce_shortfalls(plan: &Plan, launched: &Launched) {
    let members = plan.members();
    let of_executors = launched
        .executors
        .iter()
        .map(|(name, executor)| (name.as_str(), executor.obtained()));
    let of_threads = members
        .threads
        .iter()
        .map(|(name, thread)| (name.as_str(), thread.obtained()));
    let of_all = of_executors.chain(of_threads).flat_map(|(name, obtained)| {
        obtained
            .into_iter()
            .flat_map(|got| &got.shortfalls)
            .map(move |one| (name, one))
    });
    let all: Vec<_> = launched
        .shortfalls
        .iter()
        .map(|one| ("system", one))
        .chain(of_all)
        .collect();
    if all.is_empty() {
        return;
    }
    let what: Vec<String> = all
        .iter()
        .map(|(name, one)| format!("{name}: no {}", one.what()))
        .collect();
    // The same reason and remedy often serve several.
    let mut reasons: Vec<String> = Vec::new();
    for (_, one) in &all {
        let reason = format!("{}: {}", one.why(), one.remedy());
        if !reasons.contains(&reason) {
            reasons.push(reason);
        }
    }
    eprintln!(
        "luna: system `{}` runs with best effort, without {} of what it asked for ({}). {}",
        plan.name(),
        all.len(),
        what.join(", "),
        reasons.join(". ")
    );
}

/// Sleeps until all processes have ended or an emergency is over; buries those that end on the way. No process starts from then on. Gives
/// the OS threads, and the deadlock that was found, if one was.
fn watch(
    plan: &Plan,
    launched: &Launched,
    stolen: &mut Stolen,
) -> (Vec<NamedThread>, Option<Deadlock>) {
    let running = &launched.running;
    let mut lookout = Lookout::new();
    let mut warnings = Warnings::default();
    let mut look_again = Instant::NEVER;
    let mut seen_before = None;
    loop {
        let seen = running.living.changes();
        bury(plan, true);
        {
            let mut members = plan.members();
            if running.is_over() {
                members.phase = Phase::Ended;
                members.running = None;
                let threads = std::mem::take(&mut members.threads);
                let overrun = overrun_of(&members.started);
                drop(members);
                if let Some(error) = overrun {
                    eprintln!("luna: emergency: {error}");
                }
                return (threads, lookout.into_found());
            }
        }
        let (lines, warn_again) = warnings.collect(&plan.members(), Instant::now());
        for line in lines {
            eprintln!("{line}");
        }
        let next_sample = if running.scope.has_loops() {
            stolen.sample_if_due()
        } else {
            Instant::NEVER
        };
        // A sample is no reason to look for a deadlock.
        if seen_before.replace(seen) != Some(seen) || Instant::now() >= look_again {
            // After the burial, which may have dropped channel ends.
            let (found, until) = lookout.look(plan, running);
            look_again = until;
            if let Some(deadlock) = found {
                eprintln!("luna: {deadlock}");
                if running.mode == Mode::Strict {
                    // The machine may stand in the middle of a movement.
                    running.emergency.trigger();
                }
            }
        }
        let until = look_again.min(warn_again).min(next_sample);
        running.living.wait(seen, until);
    }
}

/// What the report needs to say why cycles were late.
struct Known {
    names: HashMap<ProcessId, String>,
    stolen: Stolen,
}

impl Witness for Known {
    fn name_of(&self, process: ProcessId) -> Option<String> {
        self.names.get(&process).cloned()
    }

    fn stolen(&self, core: usize, from: Instant, until: Instant) -> Option<Duration> {
        self.stolen.between(core, from, until)
    }
}

/// Runs `post_run` of the processes that have ended, drops them, and frees what they left.
fn bury(plan: &Plan, tell: bool) {
    loop {
        // One at a time and without the lock, since `post_run` may take long, and spawn.
        let next = {
            let mut members = plan.members();
            let emergency = members
                .running
                .as_ref()
                .map(|running| running.emergency.clone());
            let found = members
                .started
                .iter_mut()
                .find(|one| !one.buried && one.handle.exit().is_some());
            found.map(|member| {
                member.buried = true;
                member.error = error_of(member);
                // Whoever panicked has triggered the emergency already, unless it was the thread around the body.
                if matches!(member.handle.exit(), Some(Exit::Panicked(_)))
                    && let Some(emergency) = &emergency
                {
                    emergency.trigger();
                }
                if let Some(error) = &member.error
                    && tell
                {
                    eprintln!("luna: {error}");
                }
                let mut resident = member.resident.take();
                if member.handle.has_left_body() {
                    // The body that was left may still be found by others, and refers to it.
                    std::mem::forget(resident.take());
                }
                (resident, was_sentenced(member))
            })
        };
        match next {
            // What it holds outside of its body goes as the body went.
            Some((resident, true)) => current::poison_dropped_ends(|| clean_up(resident)),
            Some((resident, false)) => clean_up(resident),
            None => break,
        }
    }
    reclaim::collect();
}

/// Whether the process was ended for an overrun.
fn was_sentenced(member: &Member) -> bool {
    member.handle.exit() == Some(Exit::Cancelled)
        && member
            .ledger
            .as_ref()
            .is_some_and(|ledger| ledger.is_sentenced())
}

/// The overrun for which the system ends, if it does for one, with its culprit.
fn overrun_of(members: &[Member]) -> Option<Error> {
    members.iter().find_map(|member| {
        let offence = member.ledger.as_ref()?.emergency()?;
        Some(Error::from(offence).in_process(&member.name))
    })
}

fn error_of(member: &Member) -> Option<Error> {
    let offence = member.ledger.as_ref().and_then(|ledger| ledger.offence());
    let error = match (member.handle.exit()?, member.verdict.take()) {
        (Exit::Panicked(message), _) => Error::Panicked(message),
        (Exit::Cancelled, _) => offence.map_or(Error::Cancelled, Error::from),
        (_, Some(Ended::Returned(Err(error)))) => error,
        (_, Some(Ended::Failed(failure))) => failure.into(),
        _ => return None,
    };
    Some(error.in_process(&member.name))
}

/// Asks all threads to end, waits for them a bounded time, and leaves behind who does not.
/// Processes that have ended do not wait for those that have not: they are buried meanwhile.
fn end_threads(
    plan: &Plan,
    executors: Vec<(String, Executor)>,
    threads: Vec<NamedThread>,
) -> Vec<ThreadReport> {
    for (_, executor) in &executors {
        executor.request_stop();
    }
    for (_, thread) in &threads {
        thread.request_stop();
    }
    let deadline = Instant::now() + GRACE;
    let mut reports = Vec::new();
    for (name, executor) in executors {
        let ended = wait_until(plan, deadline, || executor.has_stopped());
        reports.push(thread_report(name, executor.obtained(), !ended));
        if ended {
            executor.stop();
        } else {
            executor.abandon();
        }
    }
    for (name, thread) in threads {
        let ended = wait_until(plan, deadline, || thread.has_stopped());
        reports.push(thread_report(name, thread.obtained(), !ended));
        if ended {
            drop(thread);
        } else {
            thread.abandon();
        }
    }
    for report in reports.iter().filter(|report| report.abandoned) {
        eprintln!(
            "luna: `{}` did not end within {GRACE:?} and is left to itself",
            report.name
        );
    }
    reports
}

/// Waits for a thread's end, and buries who ends meanwhile. There is no event for it, and nobody is in a hurry: so it looks now and then.
fn wait_until(plan: &Plan, deadline: Instant, mut done: impl FnMut() -> bool) -> bool {
    let mut pause = Duration::from_micros(20);
    while !done() {
        bury(plan, false);
        if Instant::now() >= deadline {
            return false;
        }
        std::thread::sleep(pause);
        pause = (pause * 2).min(Duration::from_millis(5));
    }
    true
}

fn thread_report(name: String, obtained: Option<&Obtained>, abandoned: bool) -> ThreadReport {
    ThreadReport {
        name,
        policy: obtained.map_or(Policy::Other, |got| got.policy),
        core: obtained.and_then(|got| got.core),
        shortfalls: obtained
            .map(|got| got.shortfalls.clone())
            .unwrap_or_default(),
        abandoned,
    }
}

fn process_report(member: &Member) -> ProcessReport {
    ProcessReport {
        name: member.name.clone(),
        exit: member.handle.exit(),
        polls: member.handle.polls(),
        longest_poll: member.handle.longest_poll(),
        budgets: member
            .ledger
            .as_ref()
            .map(|ledger| ledger.reports())
            .unwrap_or_default(),
    }
}

fn is_panic(error: &Error) -> bool {
    matches!(error, Error::Process { source, .. } if matches!(**source, Error::Panicked(_)))
}

fn has_panicked(members: &[Member]) -> bool {
    let mut errors = members.iter().filter_map(|member| member.error.as_ref());
    errors.any(is_panic)
}

/// The error that the run returns: a panic's before all others, since it is the cause; none if a signal ended the system, since what
/// processes return while they are being ended says nothing.
fn first_error(members: &[Member], report: &Report) -> Option<Error> {
    let wanted = |error: &&Error| match report.end {
        End::Signal(_) => false,
        End::Panic => is_panic(error),
        End::Completed => true,
        // What they return while they are being ended says nothing either.
        End::Deadlock | End::Overrun => false,
    };
    if report.end == End::Overrun {
        return overrun_of(members);
    }
    if report.end == End::Deadlock {
        return report.deadlock.clone().map(Box::new).map(Error::Deadlock);
    }
    members
        .iter()
        .filter_map(|member| member.error.as_ref())
        .find(wanted)
        .cloned()
}
