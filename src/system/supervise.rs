//! The run: from the release of the bodies to the report.

use super::deadlock::Deadlock;
use super::launch::{Launched, launch};
use super::pending_errors::PendingErrors;
use super::plan::{Phase, Plan, Running};
use super::quiet::Lookout;
use super::register::{Funeral, Register};
use super::stolen::{Stolen, Window};
use super::system_threads::SystemThreads;
use super::warnings::Warnings;
use crate::csp::process::{Common, clean_up};
use crate::error::{Error, Result, SetupError};
use crate::notice::notice;
use crate::parameters::FileWatch;
use crate::record::RecordError;
use crate::report::{End, Report};
use crate::safety::{Cause, Emergency};
use crate::time::{ManagerThread, StolenTime, Witness};
use luna_core::current::ProcessId;
use luna_core::{current, reclaim};
use luna_executors::{Executor, ProcessState, Standstill};
use luna_platform::clock::{Clock, Instant};
use luna_platform::shortfall::Shortfall;
use luna_platform::signals::HeldBack;
use luna_platform::thread::{HandlerStack, Mode};
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

/// The pause of the thread that runs the system between two passes over unhurried ends: at first,
/// and if there are always more.
const SHORTEST_REST: Duration = Duration::from_millis(1);
const LONGEST_REST: Duration = Duration::from_millis(16);

/// See [`System::run`](crate::System::run).
pub(super) fn run(plan: &Plan) -> Result<Report> {
    if current::home().is_some() {
        return Err(SetupError::Nested.into());
    }
    // Also in a blocking call of a process on virtual time: this system has a clock of its own.
    let _clock = Clock::REAL.enter();
    // The emergency manager takes signals, since it has a higher priority. The handlers need a
    // stack of their own, should this thread use up its stack.
    let _handlers = HandlerStack::here();
    let _held_back = HeldBack::here();
    let mut launched = launch(plan)?;
    // Dropped before what was launched: the emergency functions come first, should this thread
    // panic.
    let mut system_threads = SystemThreads {
        plan,
        simulation: launched.simulation.take(),
        executors: std::mem::take(&mut launched.executors).into(),
        threads: VecDeque::new(),
        has_left_behind: false,
        is_over: false,
    };
    announce_shortfalls(plan, &launched.shortfalls, &system_threads.executors);

    let running = launched.running.clone();
    let Common {
        scope,
        emergency,
        living,
        clock,
        ..
    } = &*running.common;
    let (started, really_started) = (scope.begin(), Instant::now());
    if let Some(simulation) = &running.simulation {
        simulation.attend();
    }
    // If an emergency has run its functions before the start, the processes are not released.
    if !emergency.has_begun() {
        launched.emergency.arm();
        for (_, executor) in &system_threads.executors {
            executor.release();
        }
        for (_, thread) in &plan.members().threads {
            thread.release();
        }
    }
    if let Some(simulation) = &system_threads.simulation {
        // All at once, in their order.
        simulation.release();
    }

    let mut stolen = Stolen::begin();
    let pending = PendingErrors::default();
    let deadlock = watch(&mut system_threads, &launched, &mut stolen, &pending);
    let standstill = running.standstill().filter(|_| !emergency.is_safe());
    let (elapsed, really_elapsed) = (clock.now() - started, Instant::now() - really_started);
    let Launched {
        clock: clock_kind,
        emergency: guard,
        parent,
        guardian,
        timers,
        shortfalls,
        recording,
        ..
    } = launched;
    // The processes that failed before time stood still. Errors that processes return while they
    // are being ended do not count.
    let failed_before = standstill.and_then(|_| {
        let reaper = Reaper {
            plan,
            running: &running,
            errors: Some(&pending),
        };
        reaper.reap();
        plan.members().started.first_error().cloned()
    });
    // No callback is called any more; loops that have not ended yet take their own deadlines.
    let (timers, callback_panic) = timers.map(ManagerThread::stop).unzip();
    let end = Reaper {
        plan,
        running: &running,
        errors: None,
    };
    let threads = system_threads.end(|deadline, done| wait_until(&end, deadline, done));
    end.reap();
    // A detached thread may have ended since.
    plan.members().started.note_last_ends(living, emergency);
    end.reap();
    drop(parent);
    let signal = guard.stop().or_else(|| match emergency.cause() {
        // A crash, by a signal that was then handled in another way.
        Some((_, Cause::Signal(number))) => Some(number),
        _ => None,
    });
    #[cfg(unix)]
    plan.devices().let_go();
    // Only now: a process that was cancelled where time stood still may have raised one, or
    // panicked, on the way out.
    let was_emergency = emergency.is_safe();
    stolen.sample(|window| {
        // On virtual time each recording must be the same.
        if scope.has_loops() && !clock_kind.is_virtual() {
            tell_stolen(&running, window);
        }
    });
    let safety = emergency.conclude();
    if let Some(guardian) = guardian {
        guardian.end(safety.failed().next().is_none());
    }
    for function in safety.failed() {
        // Only now: standard error may be a pipe without a reader.
        notice!("luna: emergency function {function}; the others ran");
    }
    plan.parameters().end();
    // Only detached threads of the system can still record.
    #[cfg_attr(
        not(feature = "logger"),
        expect(unused_variables, reason = "without the logger there is none")
    )]
    let recording = recording.finish();

    let mut members = plan.members();
    for left_behind in members.started.left_behind() {
        if left_behind.handle.state() == ProcessState::Running {
            notice!(
                "luna: process `{}` was still computing or in a blocking call, so its `post_run` does not run",
                left_behind.name()
            );
        }
        // Its body still exists, on the detached thread, and refers to them.
        std::mem::forget(left_behind.take_resident());
    }
    for line in Warnings::rest(&members) {
        notice!("{line}");
    }
    let recorded = running.common.tapes.finish();
    let processes = members.started.reports();
    let known = Known {
        started: &members.started,
        stolen,
    };
    let overrun = members.started.overrun();
    let raised = emergency.cause().and_then(|(process, cause)| {
        let error = match cause {
            Cause::Raised(error) => error,
            Cause::ParentDied | Cause::GuardianLost => Error::other(cause.to_string()),
            _ => return None,
        };
        match process.and_then(|process| members.started.name(process)) {
            Some(name) => Some(error.in_process(name)),
            None => Some(error),
        }
    });
    let report = Report {
        system: plan.name().to_owned(),
        end: match (
            signal,
            was_emergency,
            members.started.first_panic().is_some(),
        ) {
            (Some(number), _, _) => End::Signal(number),
            (None, true, _) if raised.is_some() => End::Emergency,
            (None, true, false) if deadlock.is_some() && running.mode == Mode::Strict => {
                End::Deadlock
            }
            (None, true, false) if overrun.is_some() => End::Overrun,
            (None, true, _) => End::Panic,
            (None, false, _) => match standstill {
                Some(Standstill::Livelock { .. }) => End::Livelock,
                Some(_) => End::Undriven,
                None => End::Completed,
            },
        },
        clock: clock_kind,
        elapsed,
        really_elapsed,
        threads,
        processes,
        earlier: members.started.earlier(),
        loops: scope.take_reports(&known),
        stand_ins: plan.stand_ins().replaced(),
        shortfalls,
        deadlock,
        timers,
        safety,
        #[cfg(feature = "logger")]
        logging: recording,
        record: recorded.as_ref().ok().copied().flatten(),
    };
    let cause = if report.end == End::Emergency {
        raised
    } else {
        overrun
    };
    let livelock = livelock(&members.started, standstill, clock.now());
    if let Some(livelock) = livelock.as_ref().filter(|_| report.end != End::Livelock) {
        // The first cause of the system's end, though a graver error followed.
        notice!("luna: {livelock}");
    }
    let error = match report.end {
        End::Undriven => failed_before,
        End::Livelock => livelock,
        _ => error_of_run(&members.started, cause, &report)
            .or_else(|| callback_panic.flatten().filter(|_| signal.is_none()))
            .or_else(|| caught_panic(&members.started, emergency, &report)),
    }
    // For any end of the system: something may not be as its process was to leave it.
    .or_else(|| members.started.first_cleanup().cloned());
    let error = match (error, recorded) {
        // Errors that processes return in a replay that has diverged do not count.
        (_, Err(error @ RecordError::Diverged(_))) => Some(error.into()),
        (None, Err(error)) => Some(error.into()),
        (None, Ok(_)) => running.common.tapes.outside().map(Error::from),
        (error, _) => error,
    };
    members.report = Some(report.clone());
    drop(members);
    system_threads.is_over = true;
    pending.settle(error.as_ref());
    match error {
        Some(error) => Err(error),
        None => Ok(report),
    }
}

/// Reports once what the system runs without.
fn announce_shortfalls(
    plan: &Plan,
    of_system: &[Shortfall],
    executors: &VecDeque<(String, Executor)>,
) {
    let members = plan.members();
    let of_executors = executors
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
    let all: Vec<_> = of_system
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
    // Several shortfalls often share one reason and remedy.
    let mut reasons: Vec<String> = Vec::new();
    for (_, one) in &all {
        let reason = format!("{}: {}", one.why(), one.remedy());
        if !reasons.contains(&reason) {
            reasons.push(reason);
        }
    }
    notice!(
        "luna: system `{}` runs with best effort, without {} of what it asked for ({}). {}",
        plan.name(),
        all.len(),
        what.join(", "),
        reasons.join(". ")
    );
}

fn tell_stolen(running: &Running, window: &Window) {
    let log = &running.common.log;
    log.tell_stolen(window.core, window.stolen, window.length());
}

/// Sleeps until all processes have ended or an emergency is over; reaps those that end on the way.
/// No process starts from then on. Passes the OS threads to `system_threads`, and returns the
/// deadlock that was found, if one was.
fn watch(
    system_threads: &mut SystemThreads<'_>,
    launched: &Launched,
    stolen: &mut Stolen,
    pending: &PendingErrors,
) -> Option<Deadlock> {
    let plan = system_threads.plan;
    let running = &launched.running;
    let Common {
        scope,
        emergency,
        living,
        ..
    } = &*running.common;
    let mut lookout = Lookout::new();
    let mut warnings = Warnings::default();
    let mut look_again = Instant::NEVER;
    let mut seen_before = None;
    let mut rest = SHORTEST_REST;
    // On a virtual clock there is no defined time for a look.
    let every = launched
        .look_at_parameters
        .filter(|_| !launched.clock.is_virtual());
    let mut file = every.and_then(|every| FileWatch::new(plan.parameters(), every));
    loop {
        let seen = living.changes();
        if emergency.has_begun() && !emergency.is_safe() {
            // The emergency functions come first: no `post_run` runs before they have, which is
            // announced.
            living.wait(seen, Instant::NEVER);
            continue;
        }
        let reaper = Reaper {
            plan,
            running,
            // The run returns the error that caused an emergency; errors that others return from
            // then on do not count.
            errors: (!emergency.has_begun()).then_some(pending),
        };
        let have_ended = reaper.reap();
        {
            let mut members = plan.members();
            if running.is_over() {
                members.phase = Phase::Ended;
                members.running = None;
                system_threads.threads = std::mem::take(&mut members.threads).into();
                let overrun = members.started.overrun();
                drop(members);
                if let Some(error) = overrun {
                    pending.add(&error);
                }
                return lookout.into_found(plan, running);
            }
        }
        let (lines, warn_again) = warnings.collect(&plan.members(), Instant::now());
        for line in lines {
            notice!("{line}");
        }
        // Time that a hypervisor takes makes no loop late where time stands meanwhile.
        let next_sample = if scope.has_loops() && !launched.clock.is_virtual() {
            stolen.sample_if_due(|window| tell_stolen(running, window))
        } else {
            Instant::NEVER
        };
        // A sample is no reason to look for a deadlock.
        if seen_before.replace(seen) != Some(seen) || Instant::now() >= look_again {
            // After the reaper, which may have dropped channel ends.
            let (found, until) = lookout.look(plan, running);
            look_again = until;
            if let Some(deadlock) = found {
                if running.mode == Mode::Strict {
                    // The machine may stand in the middle of a movement.
                    emergency.trigger(Cause::Deadlock);
                    pending.add(&Error::Deadlock(Box::new(deadlock.clone())));
                } else {
                    notice!("luna: {deadlock}");
                }
            }
        }
        let mut until = look_again.min(warn_again).min(next_sample);
        until = until.min(pending.report_due());
        if let Some(file) = &mut file {
            if let Err(error) = file.look(plan.parameters()) {
                notice!("luna: {error}");
            }
            until = until.min(file.next());
        }
        if have_ended {
            // More may end soon, and need not wake this thread one by one.
            living.rest(seen, until.min(Instant::now() + rest));
            rest = (rest * 2).min(LONGEST_REST);
        } else {
            living.wait(seen, until);
            rest = SHORTEST_REST;
        }
    }
}

/// What the report needs to explain why cycles were late.
struct Known<'a> {
    started: &'a Register,
    stolen: Stolen,
}

impl Witness for Known<'_> {
    fn name_of(&self, process: ProcessId) -> Option<String> {
        self.started.name(process).map(str::to_owned)
    }

    fn stolen(&self, core: usize, from: Instant, until: Instant) -> Option<StolenTime> {
        self.stolen.between(core, from, until)
    }
}

/// Runs `post_run` of the processes that have ended, drops them, and frees what they left.
struct Reaper<'a> {
    plan: &'a Plan,
    running: &'a Running,
    /// Where errors go; `None` while processes are being ended, since their errors do not count
    /// then.
    errors: Option<&'a PendingErrors>,
}

impl Reaper<'_> {
    /// Whether a process has ended since the last time, or there is another reason to come again
    /// soon. O(their number).
    fn reap(&self) -> bool {
        let mut have_ended = false;
        let Common {
            living,
            emergency,
            clock,
            ..
        } = &*self.running.common;
        let hurried = living.hurried();
        let clock = clock.enter();
        loop {
            // One at a time and without the lock, since `post_run` may take long, and spawn.
            let next = {
                let mut members = self.plan.members();
                members.started.note_ends(living, emergency);
                have_ended |= members.started.take_news();
                members.started.next_funeral()
            };
            let Some(Funeral {
                resident,
                of,
                was_sentenced,
                error,
                forgotten,
            }) = next
            else {
                break;
            };
            let _ = catch_unwind(AssertUnwindSafe(|| drop(forgotten)));
            if let (Some(error), Some(errors)) = (error, self.errors) {
                errors.add(&error);
            }
            let panicked = if was_sentenced {
                // What it holds outside of its body is dropped in the same way as the body was.
                current::poison_dropped_ends(|| clean_up(resident))
            } else {
                clean_up(resident)
            };
            if let Some(error) = panicked
                && let Some((order, process)) = of
            {
                let error = error.in_process(process.name());
                if let Some(errors) = self.errors {
                    errors.add(&error);
                }
                self.plan.members().started.note_cleanup(order, &error);
            }
        }
        reclaim::collect();
        drop(clock);
        if let Some(simulation) = &self.running.simulation {
            simulation.attended(hurried);
        }
        have_ended
    }
}

/// Waits for a thread's end, and reaps the processes that end meanwhile. There is no event for it,
/// and it is not urgent: so it polls at intervals.
fn wait_until(reaper: &Reaper<'_>, deadline: Instant, done: &dyn Fn() -> bool) -> bool {
    let mut pause = Duration::from_micros(20);
    while !done() {
        reaper.reap();
        if Instant::now() >= deadline {
            return false;
        }
        std::thread::sleep(pause);
        pause = (pause * 2).min(Duration::from_millis(5));
    }
    true
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
fn error_of_run(started: &Register, cause: Option<Error>, report: &Report) -> Option<Error> {
    match report.end {
        // Errors that processes return while they are being ended do not count.
        End::Signal(_) | End::Undriven | End::Livelock => None,
        End::Deadlock => report.deadlock.clone().map(Box::new).map(Error::Deadlock),
        End::Overrun | End::Emergency => cause,
        End::Panic => started.first_panic().cloned(),
        End::Completed => started.first_error().cloned(),
    }
}
