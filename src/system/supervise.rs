//! The run: from the release of the bodies to the report.

use super::announcement::Announcement;
use super::conclusion::{Ended, conclude};
use super::launch::{Launched, launch};
use super::plan::{Members, Phase, Plan, Running};
use super::quiescence::Lookout;
use super::reaper::{Reaper, wait_until};
use super::stolen::{Stolen, Window};
use super::system_threads::{SystemThreads, note_limits};
use super::warnings::{PendingErrors, Warnings, announce_shortfalls};
use crate::error::{Error, Result, SetupError};
use crate::notice::notice;
use crate::report::{Report, StampReport};
use crate::safety::{Cause, EmergencyThread};
use crate::time::ManagerThread;
use luna_config::parameters::FileWatch;
use luna_core::current;
use luna_error::Deadlock;
use luna_events::code;
use luna_machine::facts::Source;
use luna_machine::threads::above_users;
use luna_platform::clock::{Clock, Instant, nanos};
use luna_platform::thread::{HandlerStack, Obtained};
use std::collections::VecDeque;
use std::time::Duration;

/// The pause of the thread that runs the system between two passes over unhurried ends: at first,
/// and if there are always more.
const SHORTEST_REST: Duration = Duration::from_millis(1);
const LONGEST_REST: Duration = Duration::from_millis(16);

/// How long after its budget a poll or cycle that does not end is found, at most. Shorter budgets
/// would keep this thread busy.
const OVERDUE_AFTER: Duration = Duration::from_millis(10);

/// See [`System::run`](crate::System::run).
pub(super) fn run(plan: &Plan) -> Result<Report> {
    if current::executor_id().is_some() {
        return Err(SetupError::Nested.into());
    }
    // Also in a blocking call of a process on virtual time: this system has a clock of its own.
    let _clock = Clock::REAL.enter();
    // The handlers of crashes need a stack of their own, should this thread use up its stack.
    let _handlers = HandlerStack::here();
    let announced = plan.settings().announced.take();
    let mut launched = launch(plan)?;
    // Until the emergency's threads take none any more.
    let _held_back = launched.held_back.take();
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
    let announcement = Announcement::of(plan, announced);
    let begun = release(plan, &mut launched, &system_threads);
    let mut stolen = Stolen::begin();
    let pending = PendingErrors::default();
    let deadlock = watch(&mut system_threads, &launched, &mut stolen, &pending);
    drop(announcement);
    let (ended, signals) = end(
        launched,
        &mut system_threads,
        begun,
        deadlock,
        stolen,
        &pending,
    );
    let mut outcome = conclude(plan, ended, &|| signals.late_signal().is_some());
    system_threads.is_over = true;
    pending.settle(outcome.as_ref().err());
    let late_signal = signals.finish();
    let kept = &mut plan.members().report;
    for report in outcome.as_mut().ok().into_iter().chain(kept) {
        report.late_signal = late_signal;
    }
    outcome
}

/// When the bodies were released, on the system's clock and on the machine's.
struct Begun {
    at: Instant,
    really_at: Instant,
}

/// Releases the bodies.
fn release(plan: &Plan, launched: &mut Launched, system_threads: &SystemThreads<'_>) -> Begun {
    let common = &launched.running.common;
    let begun = Begun {
        at: common.scope.begin(),
        really_at: Instant::now(),
    };
    if let Some(simulation) = &launched.running.simulation {
        simulation.attend();
    }
    // If an emergency has run its functions before the start, the processes are not released.
    if !common.emergency.has_begun() {
        launched.safety.emergency.arm();
        // A thread that is released and always busy would keep this one from releasing the others,
        // also more urgent ones, where it has the only free core.
        let has_real_time = |obtained: Option<&Obtained>| {
            obtained.is_some_and(|obtained| obtained.policy.is_real_time())
        };
        let executors = &system_threads.executors;
        let is_real_time = executors
            .iter()
            .any(|(_, one)| has_real_time(one.obtained()))
            || (plan.members().threads.iter()).any(|(_, one)| has_real_time(one.obtained()));
        let _above_users = is_real_time.then(above_users);
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
    begun
}

/// Ends what is left of the system: its threads, and then the emergency. The thread that is given
/// with that takes signals until it is dropped.
fn end(
    launched: Launched,
    system_threads: &mut SystemThreads<'_>,
    begun: Begun,
    deadlock: Option<Deadlock>,
    mut stolen: Stolen,
    pending: &PendingErrors,
) -> (Ended, EmergencyThread) {
    let plan = system_threads.plan;
    let (running, mut safety_threads) = (launched.running, launched.safety);
    let (common, emergency) = (&running.common, &running.common.emergency);
    let standstill = running.standstill().filter(|_| !emergency.is_safe());
    let elapsed = common.clock.now() - begun.at;
    let really_elapsed = Instant::now() - begun.really_at;
    // The processes that failed before time stood still. Errors that processes return while they
    // are being ended do not count.
    let failed_before = standstill.and_then(|_| {
        let reaper = Reaper {
            plan,
            running: &running,
            errors: Some(pending),
        };
        reaper.reap();
        plan.members().started.first_error.get().cloned()
    });
    // No callback is called any more; loops that have not ended yet take their own deadlines.
    let (timers, callback_panic) = launched.timers.map(ManagerThread::stop).unzip();
    let reaper = Reaper {
        plan,
        running: &running,
        errors: None,
    };
    let mut threads = system_threads.end(|deadline, done| wait_until(&reaper, deadline, done));
    note_limits(&mut threads, &Source::machine(), really_elapsed);
    reaper.reap();
    // A detached thread may have ended since.
    plan.members().started.note_last_ends(common);
    reaper.reap();
    drop(safety_threads.parent);
    let signal = safety_threads
        .emergency
        .stop()
        .or_else(|| match emergency.cause() {
            // A crash, by a signal that was then handled in another way.
            Some((_, Cause::Signal(number))) => Some(number),
            _ => None,
        });
    #[cfg(unix)]
    plan.devices.let_go();
    // Only now: a process that was cancelled where time stood still may have raised one, or
    // panicked, on the way out.
    let was_emergency = emergency.is_safe();
    stolen.sample(|window| {
        // On virtual time each recording must be the same.
        if common.scope.has_loops() && !launched.clock.is_virtual() {
            report_stolen(&running, window);
        }
    });
    let safety = emergency.conclude();
    if let Some(guardian) = safety_threads.guardian {
        guardian.end(safety.failed().next().is_none());
    }
    for function in safety.failed() {
        // Only now: standard error may be a pipe without a reader.
        notice!("luna: emergency function {function}");
    }
    plan.parameters.end();
    // Only detached threads of the system can still record.
    #[cfg_attr(
        not(feature = "logger"),
        expect(unused_variables, reason = "without the logger there is none")
    )]
    let (logging, shown) = launched
        .recording
        .finish(|| safety_threads.emergency.late_signal().is_some());
    let ended = Ended {
        report: Report {
            system: plan.name().to_owned(),
            clock: launched.clock,
            stamps: launched.stamps.map(StampReport::new),
            elapsed,
            really_elapsed,
            threads,
            shortfalls: launched.shortfalls,
            deadlock,
            timers,
            safety,
            #[cfg(feature = "logger")]
            logging,
            ..Report::default()
        },
        standstill,
        failed_before,
        callback_panic: callback_panic.flatten(),
        signal,
        was_emergency,
        stolen,
        running,
        shown,
    };
    (ended, safety_threads.emergency)
}

/// Looks for polls and cycles that do not end, `now` being read before the ends of processes were
/// noted. Returns when to look again, and whether one was found for the first time.
fn look_for_overdue(members: &Members, now: Instant) -> (Instant, bool) {
    let ledgers = members.started.monitored();
    let running = ledgers.filter(|(_, member)| !member.is_reaped);
    let looks = running.filter_map(|(_, member)| Some(member.ledger.as_ref()?.look(now)));
    let (next, is_overdue) = looks.fold((Instant::NEVER, false), |all, one| {
        (all.0.min(one.0), all.1 | one.1)
    });
    match next {
        Instant::NEVER => (next, is_overdue),
        next => (next.max(now + OVERDUE_AFTER), is_overdue),
    }
}

fn report_stolen(running: &Running, window: &Window) {
    let log = &running.common.log;
    let arguments = [nanos(window.stolen), nanos(window.length())];
    log.report(code::STOLEN, window.core as u32, arguments);
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
    let common = &running.common;
    let (emergency, registry) = (&common.emergency, &common.registry);
    let mut lookout = Lookout::new();
    let mut warnings = Warnings::default();
    let mut look_again = Instant::NEVER;
    let mut seen_before = None;
    let mut rest = SHORTEST_REST;
    // On a virtual clock there is no defined time for a look.
    let every = launched
        .look_at_parameters
        .filter(|_| !launched.clock.is_virtual());
    let _file =
        every.and_then(|every| FileWatch::start(&plan.parameters, every, crate::notice::line));
    loop {
        let seen = registry.changes();
        if emergency.has_begun() && !emergency.is_safe() {
            // The emergency functions come first: no `post_run` runs before they have, which is
            // announced.
            registry.wait(seen, Instant::NEVER);
            continue;
        }
        let reaper = Reaper {
            plan,
            running,
            // The run returns the error that caused an emergency; errors that others return from
            // then on do not count.
            errors: (!emergency.has_begun()).then_some(pending),
        };
        let before_reaping = Instant::now();
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
        // On a virtual clock budgets count another time than this thread's.
        let (overdue_at, is_overdue) = match launched.clock.is_virtual() {
            true => (Instant::NEVER, false),
            false => look_for_overdue(&plan.members(), before_reaping),
        };
        // Without the lock of the members, which an emergency function may need.
        if is_overdue {
            emergency.trigger(Cause::Overrun);
        }
        let (lines, warn_again) = warnings.collect(&plan.members(), Instant::now());
        for line in lines {
            notice!("{line}");
        }
        // Time that a hypervisor takes makes no loop late where time stands meanwhile.
        let next_sample = if common.scope.has_loops() && !launched.clock.is_virtual() {
            stolen.sample_if_due(|window| report_stolen(running, window))
        } else {
            Instant::NEVER
        };
        // A sample is no reason to look for a deadlock.
        if seen_before.replace(seen) != Some(seen) || Instant::now() >= look_again {
            // After the reaper, which may have dropped channel ends.
            let (found, until) = lookout.look(plan, running);
            look_again = until;
            if let Some(deadlock) = found {
                if running.ends_at_deadlock() {
                    // The machine may stand in the middle of a movement.
                    emergency.trigger(Cause::Deadlock);
                    pending.add(&Error::Deadlock(Box::new(deadlock.clone())));
                } else {
                    notice!("luna: {deadlock}");
                }
            }
        }
        let until = look_again.min(warn_again).min(next_sample);
        let until = until.min(overdue_at).min(pending.report_due());
        if have_ended {
            // More may end soon, and need not wake this thread one by one.
            registry.rest(seen, until.min(Instant::now() + rest));
            rest = (rest * 2).min(LONGEST_REST);
        } else {
            registry.wait(seen, until);
            rest = SHORTEST_REST;
        }
    }
}
