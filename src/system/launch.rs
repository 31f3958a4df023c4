//! The start: threads first, then every `pre_run`, then the release of all bodies.

mod machine;
mod processes;
mod safety;

use super::clock::ClockKind;
use super::neighbours;
use super::plan::{ExecutorPlan, Phase, Plan, ProcessPlan, Running, Settings};
use super::register::REMEMBERED;
use crate::csp::composition::{ThreadKind, ThreadPart};
use crate::csp::process::Common;
use crate::error::{Error, Result, SetupError};
use crate::logging::{Log, Session};
use crate::safety::{EmergencyThread, GuardianWatch, ParentThread};
use crate::time::{MOST_CALLBACKS, ManagerThread, Scope};
use luna_executors::{Executor, ProcessRegistry, Simulation, SimulationHandle};
use luna_platform::clock::Clock;
use luna_platform::latency::DmaLatency;
use luna_platform::memory::MemoryLock;
use luna_platform::shortfall::Shortfall;
use luna_platform::thread::{Attributes, Mode, Policy, TIMER_PRIORITY};
use machine::{lock_memory, obtained, policy_of, real_time_cores};
use processes::{Held, pre_run_all};
use safety::watch_parent;
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
    /// What runs the executors, if their time is virtual.
    pub(super) simulation: Option<Simulation>,
    pub(super) executors: Vec<(String, Executor)>,
    pub(super) running: Arc<Running>,
    pub(super) emergency: EmergencyThread,
    pub(super) parent: Option<ParentThread>,
    pub(super) guardian: Option<GuardianWatch>,
    pub(super) timers: Option<ManagerThread>,
    pub(super) shortfalls: Vec<Shortfall>,
    pub(super) recording: Session,
    pub(super) look_at_parameters: Option<Duration>,
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
        members.places = members.executors.iter().map(ExecutorPlan::part).collect();
        (
            std::mem::take(&mut members.executors),
            std::mem::take(&mut members.waiting),
        )
    };
    let settings = std::mem::take(&mut *plan.settings());
    let living = Arc::new(ProcessRegistry::new());
    // Also a start that fails on these takes the settings, so that the driver of its clock is
    // notified.
    let launched =
        stand_ins.and_then(|()| launch_described(plan, settings, executors, waiting, &living));
    launched.inspect_err(|_| {
        living.close_ended(|_| ());
        plan.parameters().end();
        let mut members = plan.members();
        members.phase = Phase::Ended;
        let never_prepared = std::mem::take(&mut members.waiting);
        // The user's code drops them.
        drop(members);
        drop(never_prepared);
        // The functions will not run any more.
        plan.emergency().conclude();
    })
}

fn launch_described(
    plan: &Plan,
    mut settings: Settings,
    mut executor_plans: Vec<ExecutorPlan>,
    mut waiting: Vec<ProcessPlan>,
    living: &Arc<ProcessRegistry>,
) -> Result<Launched> {
    let clock_kind = settings.clock.kind();
    let is_virtual = clock_kind.is_virtual();
    let simulation = std::mem::take(&mut settings.clock).start(living, settings.most_turns)?;
    let handle = simulation.as_ref().map(Simulation::handle);
    let clock = handle.as_ref().map_or(Clock::REAL, SimulationHandle::clock);
    // What runs of the user's on this thread until the release sees the system's time.
    let _clock = clock.enter();
    if !is_virtual {
        neighbours::settle(&mut executor_plans, &mut waiting);
    }
    let mode = if settings.strict {
        Mode::Strict
    } else {
        Mode::BestEffort
    };
    // On a clock of its own nothing has to come in time, so nothing is asked of the machine for
    // that.
    let real_time = !is_virtual
        && (executor_plans
            .iter()
            .any(|executor| executor.attributes.asked_policy().is_real_time())
            || waiting
                .iter()
                .any(|process| policy_of(process).is_real_time()));

    let mut shortfalls = Vec::new();
    settings.lock_memory &= !is_virtual;
    let memory = lock_memory(&settings, &mut shortfalls)?;
    // It was not requested, so its lack is no reason not to start.
    let latency = if real_time {
        obtained(DmaLatency::hold(), &mut shortfalls)
    } else {
        None
    };
    let log = Log::new(plan.name(), is_virtual);
    let recording = log.start(std::mem::take(&mut settings.logging))?;
    let recorded = settings.tapes.recorded_parameters();
    settings.tapes.parameters = plan.parameters().begin(&log, &clock, recorded.as_deref())?;
    luna_executors::prepare_blocking().map_err(|error| SetupError::Thread {
        message: error.to_string(),
    })?;

    let emergency = plan.emergency().clone();
    emergency.record(log.clone());
    if let Some(simulation) = &handle {
        emergency.simulate(simulation.clone());
    }
    // From before anything moves until all has ended.
    let guardian = match &settings.guardian {
        Some(guardian) => Some(GuardianWatch::start(
            guardian,
            emergency.clone(),
            settings.strict,
        )?),
        None => None,
    };
    let cores = real_time_cores(&executor_plans, &waiting);
    let guard = EmergencyThread::start(
        emergency.clone(),
        living.clone(),
        real_time,
        if real_time { &cores } else { &[] },
    )?;
    shortfalls.extend_from_slice(guard.shortfalls());
    let parent = if settings.parents_death {
        watch_parent(&emergency, real_time, settings.strict)?
    } else {
        None
    };

    let loops = settings.max_loops.unwrap_or(LOOPS);
    // A process on a clock that is not the machine's is woken by that clock alone.
    let manager = match settings.manager {
        Some(manager) if handle.is_some() => {
            manager.refuse()?;
            None
        }
        manager => manager,
    };
    let timers = match &manager {
        Some(manager) => {
            manager.prepare(settings.max_timers.unwrap_or(MOST_CALLBACKS))?;
            let policy = match real_time {
                true => Policy::fifo(TIMER_PRIORITY),
                false => Policy::Other,
            };
            let mut attributes = Attributes::framework("luna-timers", policy).mode(mode);
            if let Some(core) = settings.timer_core {
                attributes = attributes.core(core);
            }
            let (manager, emergency) = (manager.clone(), emergency.clone());
            let thread = ManagerThread::start(manager, emergency, loops, attributes)?;
            shortfalls.extend_from_slice(thread.shortfalls());
            Some(thread)
        }
        None => None,
    };
    let parameters = plan.parameters().clone();
    let scope = Scope::with_room_for(loops, living.clone(), clock.clone(), manager, parameters);
    // Outlives the executors: their bodies refer to it.
    let mut held = Held::default();
    let mut executors = Vec::with_capacity(executor_plans.len());
    for executor in executor_plans {
        let started = match &handle {
            None => Executor::start_counted(executor.attributes.mode(mode), living.clone())
                .map_err(|error| Error::not_started(&executor.name, error))?,
            Some(simulation) => Executor::start_simulated(simulation, &executor.attributes),
        };
        executors.push((executor.name, started));
    }
    let places: Vec<ThreadPart> = executors
        .iter()
        .map(|(name, executor)| {
            ThreadPart::obtained(name, ThreadKind::Executor, executor.obtained())
        })
        .collect();
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
            tree: plan.tree().clone(),
            living: living.clone(),
            clock: clock.clone(),
            log,
            tapes: std::mem::take(&mut settings.tapes).start(plan.name())?,
        }),
        mode,
        simulation: handle,
    });

    loop {
        // Without the plan's lock: what runs here is the user's, and may spawn.
        if let Err(error) = pre_run_all(plan, &running, &mut waiting)
            .and_then(|()| held.start_all(&running, &places, waiting))
        {
            // Their bodies end with the executors and threads.
            drop(executors);
            held.undo();
            return Err(error);
        }
        for (_, executor) in &executors {
            executor.settle();
        }
        let mut members = plan.members();
        // Processes that these have spawned already start with the others.
        waiting = std::mem::take(&mut members.waiting);
        if waiting.is_empty() {
            if let Err(error) = plan.parameters().all_declared() {
                drop(members);
                drop(executors);
                held.undo();
                return Err(error.into());
            }
            members.started.most_ended = settings.remembered.unwrap_or(REMEMBERED);
            members.started.reserve(held.members.len());
            for (id, member) in held.members {
                members.started.enter(id, member, &running.common.emergency);
            }
            members.threads = held.threads;
            members.running = Some(running.clone());
            break;
        }
    }
    Ok(Launched {
        clock: clock_kind,
        simulation,
        executors,
        running,
        emergency: guard,
        parent,
        guardian,
        timers,
        shortfalls,
        recording,
        look_at_parameters: settings.look_at_parameters,
        _memory: memory,
        _latency: latency,
    })
}
