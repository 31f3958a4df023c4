//! The start: threads first, then every `pre_run`, then the release of all bodies.

mod machine;
mod opening;
mod processes;

pub(crate) use opening::Opening;

use super::clock::ClockKind;
use super::neighbours;
use super::plan::{Phase, Plan, ProcessPlan, Running, Settings};
use super::register::REMEMBERED;
use crate::csp::composition::{ThreadKind, ThreadPart};
use crate::csp::failed_at::EndedAtChannels;
use crate::csp::process::Common;
use crate::error::{Error, Result, SetupError};
use crate::log::Session;
use crate::log::{Level, Log, message};
use crate::safety::{Emergency, EmergencyThread, GuardianWatch, ParentThread};
use crate::time::{MAX_CALLBACKS, Manager, ManagerThread, Scope, StampState};
use luna_config::parameters;
use luna_core::{Executor, ProcessRegistry, Simulation, SimulationHandle};
use luna_machine::latency::DmaLatency;
use luna_machine::memory::MemoryLock;
use luna_machine::shortfall::Shortfall;
use luna_machine::signals::HeldBack;
use luna_platform::clock::Clock;
use luna_platform::thread::{Attributes, Mode, TIMER_PRIORITY};
use machine::{Needs, lock_memory};
use processes::start_processes;
use std::sync::Arc;
use std::time::Duration;

/// Default number of loops with reserved room, if `System::max_loops` sets no other: 745 KiB in
/// all. One reserve for the system: which processes have loops is known only when their bodies run,
/// and in a large system few do. A reserve that grew with the number of processes was most of what
/// each of them took.
const LOOPS: usize = 16;

/// A system with processes that are ready to be released.
pub(super) struct Launched {
    pub(super) clock: ClockKind,
    pub(super) stamps: Option<StampState>,
    /// What runs the executors, if their time is virtual.
    pub(super) simulation: Option<Simulation>,
    pub(super) executors: Vec<(String, Executor)>,
    pub(super) running: Arc<Running>,
    pub(super) safety: SafetyThreads,
    pub(super) timers: Option<ManagerThread>,
    pub(super) shortfalls: Vec<Shortfall>,
    pub(super) recording: Session,
    pub(super) look_at_parameters: Option<Duration>,
    /// Held until the run returns.
    pub(super) held_back: Option<HeldBack>,
    _memory: Option<MemoryLock>,
    _latency: Option<DmaLatency>,
}

/// Takes the plan and starts it. On an error all that was started is ended again.
pub(super) fn launch(plan: &Plan) -> Result<Launched> {
    let stand_ins = plan.close_stand_ins();
    let (executors, waiting) = {
        let mut members = plan.members();
        if members.phase != Phase::Described {
            return Err(SetupError::AlreadyRun {
                system: plan.name().to_owned(),
            }
            .into());
        }
        members.phase = Phase::Running;
        members.places = members.executors.iter().map(ThreadPart::executor).collect();
        (
            std::mem::take(&mut members.executors),
            std::mem::take(&mut members.waiting),
        )
    };
    let settings = std::mem::take(&mut *plan.settings());
    let registry = Arc::new(ProcessRegistry::new());
    // Also a start that fails on these takes the settings, so that the driver of its clock is
    // notified.
    let launched =
        stand_ins.and_then(|()| launch_described(plan, settings, executors, waiting, &registry));
    launched.inspect_err(|_| {
        registry.close_ended(|_| ());
        plan.parameters.end();
        let mut members = plan.members();
        members.phase = Phase::Ended;
        let never_prepared = std::mem::take(&mut members.waiting);
        // The user's code drops them.
        drop(members);
        drop(never_prepared);
        // The functions will not run any more.
        plan.emergency.conclude();
    })
}

fn launch_described(
    plan: &Plan,
    mut settings: Settings,
    mut executor_plans: Vec<Attributes>,
    mut waiting: Vec<ProcessPlan>,
    registry: &Arc<ProcessRegistry>,
) -> Result<Launched> {
    if let Some(deployment) = plan.deployment() {
        let Settings {
            strict,
            lock_memory,
            ..
        } = &mut settings;
        let waiting = waiting
            .iter_mut()
            .map(|process| (&**process.spec.name(), process.place.executor()));
        deployment.settle(strict, lock_memory, waiting)?;
    }
    let clock_kind = settings.clock.kind();
    let is_virtual = clock_kind.is_virtual();
    let simulation = std::mem::take(&mut settings.clock).start(registry, settings.most_turns)?;
    let handle = simulation.as_ref().map(Simulation::handle);
    let clock = handle.as_ref().map_or(Clock::REAL, SimulationHandle::clock);
    // What runs of the user's on this thread until the release sees the system's time.
    let _clock = clock.enter();
    if !is_virtual {
        neighbours::settle(&mut executor_plans, &mut waiting);
    }
    settings.lock_memory &= !is_virtual;
    let needs = Needs::of(&settings, is_virtual, &executor_plans, &waiting);
    let mut shortfalls = Vec::new();
    let memory = lock_memory(&settings, &mut shortfalls)?;
    let latency = needs.hold_latency(&mut shortfalls);
    let log = plan.log.clone();
    let emergency = plan.emergency.clone();
    emergency.journal.record(log.clone());
    if let Some(simulation) = &handle {
        emergency.simulate(simulation.clone());
    }
    // The emergency manager takes signals, since it has a higher priority. They are held back as
    // its threads start, and these start before any file is opened: it may not answer.
    let held_back = HeldBack::here();
    let (own, cores) = (emergency.clone(), &needs.cores);
    let guard = EmergencyThread::start(own, registry.clone(), needs.real_time, cores)?;
    shortfalls.extend(guard.shortfalls().iter().map(Shortfall::of));
    let opening = Opening::new(&emergency);
    let asked = std::mem::take(&mut settings.logging);
    let shown = parameters::Parameters::new(plan.parameters.clone());
    let recording = log.start(is_virtual, asked, settings.replaces, &opening, shown)?;
    let recorded = settings.replay_logs.recorded_parameters();
    let file = match plan.parameters.file() {
        Some(file) if recorded.is_none() => {
            let what = format!("read the parameters `{}`", file.display());
            Some(opening.wait_for(what, move || parameters::read(&file))??)
        }
        _ => None,
    };
    settings.replay_logs.parameters =
        plan.parameters
            .begin(recorded.as_deref(), file, notify(&log, &clock))?;
    let replay_logs = std::mem::take(&mut settings.replay_logs).start(
        plan.name(),
        settings.replaces,
        |path, make| {
            opening
                .wait_for(format!("make the replay log `{}`", path.display()), make)?
                .map_err(Error::from)
        },
    )?;
    luna_core::prepare_blocking().map_err(|error| SetupError::Thread {
        message: error.to_string(),
    })?;

    let safety = SafetyThreads::start(guard, &emergency, &settings, &needs)?;
    let loops = settings.max_loops.unwrap_or(LOOPS);
    let manager = settings.manager.take();
    let (manager, timers) = match manager {
        // A process on a clock that is not the machine's is woken by that clock alone.
        Some(manager) if is_virtual => {
            manager.refuse()?;
            (None, None)
        }
        Some(manager) => {
            let thread = start_timers(&manager, &settings, &needs, loops, &emergency)?;
            shortfalls.extend(thread.shortfalls().iter().map(Shortfall::of));
            (Some(manager), Some(thread))
        }
        None => (None, None),
    };
    let parameters = plan.parameters.clone();
    let scope = Scope::with_room_for(
        loops,
        registry.clone(),
        clock.clone(),
        manager,
        parameters,
        plan.deployment().cloned(),
    );
    let executors = start_executors(executor_plans, handle.as_ref(), needs.mode, registry)?;
    let places = executors.iter().map(|(name, executor)| {
        ThreadPart::obtained(name, ThreadKind::Executor, executor.obtained())
    });
    let places: Vec<ThreadPart> = places.collect();
    plan.members().places = Vec::clone(&places);
    let handles = executors
        .iter()
        .map(|(_, executor)| executor.handle().clone())
        .collect();
    let running = Arc::new(Running {
        executors: handles,
        common: Arc::new(Common {
            scope,
            emergency,
            tree: plan.tree.clone(),
            registry: registry.clone(),
            clock: clock.clone(),
            ended_at: EndedAtChannels::new(),
            log,
            replay_logs,
        }),
        mode: needs.mode,
        simulation: handle,
    });

    let remembered = settings.remembered.unwrap_or(REMEMBERED);
    let executors = start_processes(plan, &running, executors, &places, waiting, remembered)?;
    Ok(Launched {
        clock: clock_kind,
        stamps: settings.stamps,
        simulation,
        executors,
        running,
        safety,
        timers,
        shortfalls,
        recording,
        look_at_parameters: settings.look_at_parameters,
        held_back: Some(held_back),
        _memory: memory,
        _latency: latency,
    })
}

/// What writes messages about sets of parameters.
fn notify(log: &Log, clock: &Clock) -> parameters::Notify {
    let (log, clock) = (log.clone(), clock.clone());
    Box::new(move |text| {
        if log.is_recording() {
            let (_log, _clock) = (log.enter(), clock.enter());
            message(Level::Info, "parameters", text);
        }
    })
}

/// Starts the thread of the timer manager.
fn start_timers(
    manager: &Arc<Manager>,
    settings: &Settings,
    needs: &Needs,
    loops: usize,
    emergency: &Arc<Emergency>,
) -> Result<ManagerThread> {
    manager.prepare(settings.max_timers.unwrap_or(MAX_CALLBACKS));
    let policy = needs.policy(TIMER_PRIORITY);
    let mut attributes = Attributes::framework("luna-timers", policy).mode(needs.mode);
    if let Some(core) = settings.timer_core {
        attributes = attributes.core(core);
    }
    ManagerThread::start(manager.clone(), emergency.clone(), loops, attributes)
}

fn start_executors(
    plans: Vec<Attributes>,
    simulation: Option<&SimulationHandle>,
    mode: Mode,
    registry: &Arc<ProcessRegistry>,
) -> Result<Vec<(String, Executor)>> {
    let start = |executor: Attributes| {
        let name = executor.name().to_owned();
        let started = match simulation {
            None => Executor::start_counted(executor.mode(mode), registry.clone())
                .map_err(|error| Error::not_started(&name, error))?,
            Some(simulation) => Executor::start_simulated(simulation, &executor),
        };
        Ok((name, started))
    };
    plans.into_iter().map(start).collect()
}

/// What is there from before anything moves until all has ended. If the start fails it is ended in
/// this order.
pub(super) struct SafetyThreads {
    pub(super) parent: Option<ParentThread>,
    pub(super) emergency: EmergencyThread,
    pub(super) guardian: Option<GuardianWatch>,
}

impl SafetyThreads {
    /// Starts the others beside `guard`.
    fn start(
        guard: EmergencyThread,
        emergency: &Arc<Emergency>,
        settings: &Settings,
        needs: &Needs,
    ) -> Result<Self> {
        let strict = settings.strict;
        let guardian = settings.guardian.as_ref();
        let guardian = guardian
            .map(|guardian| GuardianWatch::start(guardian, emergency.clone(), strict))
            .transpose()?;
        let parent = match settings.parents_death {
            true => ParentThread::start(emergency.clone(), needs.policy(TIMER_PRIORITY), strict)?,
            false => None,
        };
        Ok(Self {
            parent,
            emergency: guard,
            guardian,
        })
    }
}
