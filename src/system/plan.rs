//! What a system is to be, and what it has become: shared by its handles.

use super::clock::ClockPlan;
use super::neighbours;
use super::register::Register;
use super::stand_in::StandIns;
use crate::csp::composition::{ThreadKind, ThreadPart};
use crate::csp::process::{
    Build, Common, Frame, Phases, Prepared, Start, clean_up, prepare, start,
};
use crate::csp::tree::Tree;
use crate::error::{Error, Result, SetupError};
use crate::logging::Asked;
use crate::parameters::Store;
use crate::record::TapePlan;
use crate::report::Report;
use crate::safety::{Emergency, Guardian, Ledger};
use crate::time::Manager;
use luna_executors::{
    Announced, ExecutorHandle, Name, OsThread, ProcessHandle, ProcessSpec, Refused,
    SimulationHandle, Standstill,
};
use luna_platform::current::ProcessId;
use luna_platform::thread::{Attributes, Mode};
use std::collections::HashSet;
use std::panic::{AssertUnwindSafe, RefUnwindSafe, UnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A system's plan. Its locks are for the set-up, the end, and the non-real-time side.
pub(crate) struct Plan {
    name: String,
    settings: Mutex<Settings>,
    members: Mutex<Members>,
    stand_ins: Mutex<StandIns>,
    /// Nobody can be replaced any more.
    stand_ins_closed: AtomicBool,
    #[cfg(unix)]
    devices: Arc<crate::devices::Devices>,
    tree: Arc<Tree>,
    emergency: Arc<Emergency>,
    parameters: Arc<Store>,
}

// Nothing of the user's runs under its locks, and what they guard is whole between two statements. So who catches a panic finds the system as it was, or as it ended: described, with or
// without the process that panicked as it was made, or run.
impl UnwindSafe for Plan {}
impl RefUnwindSafe for Plan {}

#[derive(Default)]
pub(crate) struct Settings {
    pub(crate) strict: bool,
    pub(crate) lock_memory: bool,
    pub(crate) max_loops: Option<usize>,
    /// Who wakes the loops, if it is not their executors.
    pub(crate) manager: Option<Arc<Manager>>,
    pub(crate) max_timers: Option<usize>,
    /// The core of the timer manager.
    pub(crate) timer_core: Option<usize>,
    /// Of how many that have ended more than their number is known.
    pub(crate) remembered: Option<usize>,
    /// Whether the death of the program that started this one is an emergency.
    pub(crate) parents_death: bool,
    pub(crate) guardian: Option<Guardian>,
    pub(crate) clock: ClockPlan,
    /// What is to be recorded.
    pub(crate) logging: Asked,
    pub(crate) tapes: TapePlan,
    /// How often to look whether the file of parameters has changed.
    pub(crate) look_at_parameters: Option<Duration>,
    /// How many turns may be taken at one instant of a virtual clock; as many as stated.
    pub(crate) most_turns: Option<u64>,
}

/// Where a process is to run.
pub(crate) enum Place {
    /// The executor with this number.
    Executor(usize),
    /// A thread of its own.
    Thread {
        name: String,
        attributes: Box<Attributes>,
    },
}

/// An executor to be.
pub(crate) struct ExecutorPlan {
    pub(crate) name: String,
    pub(crate) attributes: Attributes,
}

impl ExecutorPlan {
    /// It as a part of the system, as it was asked for.
    pub(crate) fn part(&self) -> ThreadPart {
        ThreadPart::asked(&self.name, ThreadKind::Executor, &self.attributes)
    }
}

/// A process to be, whose body `B` makes.
pub(crate) struct ProcessPlan<B = Box<dyn Start>> {
    pub(crate) place: Place,
    pub(crate) spec: ProcessSpec,
    /// Others may have its name too.
    pub(crate) shares_name: bool,
    pub(crate) ledger: Option<Arc<Ledger>>,
    pub(crate) prepared: Prepared<B>,
}

impl<B> ProcessPlan<B> {
    pub(crate) fn name(&self) -> &Name {
        self.spec.name()
    }

    pub(crate) fn id(&self) -> ProcessId {
        self.spec.id()
    }

    /// Its name, if it is to be its own; else the name as an error.
    fn own_name(&self) -> Result<&Name, &Name> {
        match self.shares_name {
            false => Ok(self.name()),
            true => Err(self.name()),
        }
    }
}

impl<B: Build> ProcessPlan<B> {
    /// It among others, whatever makes them.
    fn boxed(self) -> ProcessPlan {
        ProcessPlan {
            place: self.place,
            spec: self.spec,
            shares_name: self.shares_name,
            ledger: self.ledger,
            prepared: self.prepared.boxed(),
        }
    }
}

/// A process that was started. There may be very many: what few have lies apart.
pub(crate) struct Member {
    pub(crate) handle: ProcessHandle,
    seldom: Option<Box<Seldom>>,
    /// Its place in the order of starts.
    pub(crate) order: u64,
    /// The number of its executor, or [`NO_EXECUTOR`].
    executor: u32,
    /// It was spawned while the system ran.
    pub(crate) is_late: bool,
    pub(crate) shares_name: bool,
    pub(crate) has_failed: bool,
    /// Its end was noted.
    pub(crate) buried: bool,
}

/// In the place of the number of an executor: it has a thread of its own.
const NO_EXECUTOR: u32 = u32::MAX;

/// What few members have.
struct Seldom {
    ledger: Option<Arc<Ledger>>,
    resident: Option<Box<dyn Phases>>,
    thread: Option<Box<ThreadPart>>,
}

impl Member {
    pub(super) fn new(
        handle: ProcessHandle,
        on: On,
        ledger: Option<Arc<Ledger>>,
        resident: Option<Box<dyn Phases>>,
    ) -> Self {
        let (executor, thread) = match on {
            On::Executor(number) => (u32::try_from(number).unwrap_or(NO_EXECUTOR), None),
            On::Thread(part) => (NO_EXECUTOR, Some(part)),
        };
        let has_any = ledger.is_some() || resident.is_some() || thread.is_some();
        Self {
            handle,
            seldom: has_any.then(|| {
                Box::new(Seldom {
                    ledger,
                    resident,
                    thread,
                })
            }),
            order: 0,
            executor,
            is_late: false,
            shares_name: false,
            has_failed: false,
            buried: false,
        }
    }

    pub(crate) fn name(&self) -> &str {
        self.handle.name()
    }

    pub(crate) fn ledger(&self) -> Option<&Arc<Ledger>> {
        self.seldom.as_ref()?.ledger.as_ref()
    }

    /// Whether it has nothing that few have.
    pub(crate) fn is_plain(&self) -> bool {
        self.seldom.is_none()
    }

    pub(crate) fn take_resident(&mut self) -> Option<Box<dyn Phases>> {
        self.seldom.as_mut()?.resident.take()
    }

    /// Whether it shares its thread.
    pub(crate) fn is_on_executor(&self) -> bool {
        self.executor != NO_EXECUTOR
    }

    /// Where it was started.
    pub(crate) fn on(&self) -> On {
        match self
            .seldom
            .as_ref()
            .and_then(|seldom| seldom.thread.as_ref())
        {
            Some(part) => On::Thread(part.clone()),
            None => On::Executor(self.executor as usize),
        }
    }
}

/// Where a process was started.
#[derive(Clone)]
pub(crate) enum On {
    /// The executor with this number.
    Executor(usize),
    /// A thread of its own.
    Thread(Box<ThreadPart>),
}

/// What processes are started with while the system runs.
pub(crate) struct Running {
    pub(crate) executors: Vec<ExecutorHandle>,
    pub(crate) common: Arc<Common>,
    pub(crate) mode: Mode,
    /// What runs them, if their time is virtual.
    pub(crate) simulation: Option<SimulationHandle>,
}

/// An OS thread with its name.
pub(crate) type NamedThread = (String, OsThread);

/// A process that could not be started, and what is left of it to clean up.
pub(crate) struct NotStarted {
    pub(crate) error: Error,
    pub(crate) resident: Option<Box<dyn Phases>>,
}

/// A process that is entered, and not handed over to its executor yet.
pub(crate) struct Pending {
    announced: Announced,
    starter: Box<dyn Start>,
    frame: Frame,
}

impl Pending {
    /// Whether handing it over calls what is the user's.
    fn is_built_here(&mut self) -> bool {
        self.announced.is_built_here()
    }

    /// What is given is the user's: to be dropped without a lock.
    #[must_use = "what was refused is dropped without a lock"]
    pub(crate) fn hand_over(self) -> Option<Refused> {
        self.starter.on_executor(self.announced, self.frame)
    }
}

/// What comes of a process that is started.
pub(crate) enum Started {
    OnExecutor(Pending),
    OnThread(NamedThread),
}

impl Running {
    /// Whether there is nothing more to wait for: all processes have ended or time does not go on, and an emergency, if there is one, is over.
    pub(crate) fn is_over(&self) -> bool {
        let Common {
            emergency, living, ..
        } = &*self.common;
        emergency.is_safe()
            || !emergency.has_begun() && (living.count() == 0 || self.standstill().is_some())
    }

    /// Why time does not go on, if it does not.
    pub(crate) fn standstill(&self) -> Option<Standstill> {
        self.simulation.as_ref()?.standstill()
    }

    /// Announces a prepared process on an executor. Nothing of the user's runs there.
    fn announce(
        &self,
        number: usize,
        mut spec: ProcessSpec,
        ledger: Option<Arc<Ledger>>,
        resident: Option<Box<dyn Phases>>,
    ) -> (Member, Announced, Frame) {
        let common = &self.common;
        if let Some(ledger) = &ledger {
            ledger.join(&common.emergency, &common.living);
        }
        spec = spec.listed();
        if resident.is_none() && ledger.is_none() {
            spec = spec.unhurried();
        }
        if common.tapes.are_there() {
            spec = common.tapes.tape(spec);
        }
        let frame = Frame::new(common);
        let announced = self.executors[number].announce(spec);
        let on = On::Executor(number);
        let member = Member::new(announced.handle(), on, ledger, resident);
        (member, announced, frame)
    }

    /// Starts a prepared process: on a thread, which is held; on an executor once it is handed over.
    pub(crate) fn start(&self, plan: ProcessPlan) -> Result<(Member, Started), NotStarted> {
        let ProcessPlan {
            place,
            spec,
            shares_name,
            ledger,
            prepared:
                Prepared {
                    resident,
                    build: starter,
                },
        } = plan;
        let (thread_name, attributes) = match place {
            Place::Executor(number) => {
                let (mut member, announced, frame) = self.announce(number, spec, ledger, resident);
                member.shares_name = shares_name;
                let pending = Pending {
                    announced,
                    starter,
                    frame,
                };
                return Ok((member, Started::OnExecutor(pending)));
            }
            Place::Thread { name, attributes } => (name, attributes),
        };
        let common = &self.common;
        let frame = Frame::new(common);
        if let Some(ledger) = &ledger {
            ledger.join(&common.emergency, &common.living);
        }
        let name = spec.name().clone();
        let started = starter.on_thread(
            (*attributes).mode(self.mode),
            common.tapes.tape(spec.listed()),
            self.simulation.as_ref(),
            frame,
        );
        match started {
            Ok(thread) => {
                let part =
                    ThreadPart::obtained(&thread_name, ThreadKind::OsThread, thread.obtained());
                let on = On::Thread(Box::new(part));
                let handle = thread.process().clone();
                let mut member = Member::new(handle, on, ledger, resident);
                member.shares_name = shares_name;
                Ok((member, Started::OnThread((thread_name, thread))))
            }
            Err(error) => Err(NotStarted {
                error: Error::not_started(&name, error),
                resident,
            }),
        }
    }
}

#[derive(Default)]
pub(crate) struct Members {
    pub(crate) phase: Phase,
    pub(crate) executors: Vec<ExecutorPlan>,
    /// The executors that were started, as parts of the system.
    pub(crate) places: Vec<ThreadPart>,
    pub(crate) waiting: Vec<ProcessPlan>,
    /// Before who was started: dropping a thread waits for its body, which refers to its process.
    pub(crate) threads: Vec<NamedThread>,
    pub(crate) started: Register,
    pub(crate) running: Option<Arc<Running>>,
    /// Of the run that has ended.
    pub(crate) report: Option<Report>,
    thread_names: HashSet<String>,
}

#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Phase {
    #[default]
    Described,
    Running,
    Ended,
}

impl NotStarted {
    /// Cleans up what is left of it.
    fn clean_up(self) -> Error {
        clean_up(self.resident);
        self.error
    }
}

impl Members {
    /// Enters a process that starts while the system runs.
    fn enter_late(&mut self, id: ProcessId, mut member: Member, running: &Running) {
        member.is_late = true;
        self.started.enter(id, member, &running.common.emergency);
    }

    /// Takes the name of an executor or a thread.
    fn take_thread_name(&mut self, name: &str) -> Result<()> {
        if !self.thread_names.insert(name.to_owned()) {
            return Err(duplicate("executor", name));
        }
        Ok(())
    }
}

/// The name of a process that is about to be added. Dropping it gives the name back.
pub(crate) struct Reservation<'a> {
    plan: &'a Plan,
    name: Option<Name>,
}

impl Reservation<'_> {
    /// The name stays taken.
    pub(crate) fn keep(mut self) {
        self.name = None;
    }
}

impl Drop for Reservation<'_> {
    fn drop(&mut self) {
        if let Some(name) = &self.name {
            self.plan.members().started.give_name_back(name);
        }
    }
}

fn duplicate(kind: &'static str, name: &str) -> Error {
    SetupError::DuplicateName {
        kind,
        name: name.to_owned(),
    }
    .into()
}

impl Plan {
    pub(crate) fn new(name: &str) -> Arc<Self> {
        Arc::new_cyclic(|plan| Self {
            name: name.to_owned(),
            settings: Mutex::default(),
            members: Mutex::default(),
            stand_ins: Mutex::default(),
            stand_ins_closed: AtomicBool::new(false),
            #[cfg(unix)]
            devices: Default::default(),
            tree: Tree::new(),
            emergency: Emergency::new(plan.clone()),
            parameters: Store::new(name),
        })
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// The named sub-processes.
    pub(crate) fn tree(&self) -> &Arc<Tree> {
        &self.tree
    }

    pub(crate) fn emergency(&self) -> &Arc<Emergency> {
        &self.emergency
    }

    pub(crate) fn parameters(&self) -> &Arc<Store> {
        &self.parameters
    }

    pub(crate) fn settings(&self) -> MutexGuard<'_, Settings> {
        self.settings.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn stand_ins(&self) -> MutexGuard<'_, StandIns> {
        self.stand_ins
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// When the system starts: every stand-in must have found whom it stands in for.
    pub(crate) fn close_stand_ins(&self) -> Result<()> {
        self.stand_ins().close()?;
        self.stand_ins_closed.store(true, Ordering::Release);
        Ok(())
    }

    /// A process that is spawned without its ends cannot be replaced. While the system runs nobody waits to replace one.
    pub(crate) fn check_plain(&self, process: &str) -> Result<()> {
        if self.stand_ins_closed.load(Ordering::Acquire) {
            return Ok(());
        }
        self.stand_ins().check_plain(process)
    }

    #[cfg(unix)]
    pub(crate) fn devices(&self) -> &Arc<crate::devices::Devices> {
        &self.devices
    }

    pub(crate) fn members(&self) -> MutexGuard<'_, Members> {
        self.members.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Nobody will run the system: drops what it was to consist of, which may hold the plan, unless it has been run. What is dropped is the user's: without a lock.
    pub(crate) fn abandon(&self) {
        // Also of a start that failed on them.
        let stand_ins = std::mem::take(&mut *self.stand_ins());
        drop(stand_ins);
        let waiting = {
            let mut members = self.members();
            if members.phase != Phase::Described {
                return;
            }
            members.phase = Phase::Ended;
            std::mem::take(&mut members.waiting)
        };
        for process in waiting {
            // One panic in a drop, which the hook tells, keeps no other from its own.
            let _ = catch_unwind(AssertUnwindSafe(|| drop(process)));
        }
        let settings = std::mem::take(&mut *self.settings());
        drop(settings);
        self.emergency.conclude();
    }

    /// Whether the system has been run.
    pub(crate) fn has_begun(&self) -> bool {
        self.members().phase != Phase::Described
    }

    /// Adds an executor; gives its number.
    pub(crate) fn add_executor(&self, executor: ExecutorPlan) -> Result<usize> {
        let mut members = self.members();
        if members.phase != Phase::Described {
            return Err(SetupError::AlreadyRun {
                system: self.name.clone(),
            }
            .into());
        }
        members.take_thread_name(&executor.name)?;
        members.executors.push(executor);
        Ok(members.executors.len() - 1)
    }

    /// Takes the name of an OS thread, which executors share.
    pub(crate) fn take_thread_name(&self, name: &str) -> Result<()> {
        self.members().take_thread_name(name)
    }

    /// Takes the name of a process whose body is still to be made.
    pub(crate) fn reserve<'a>(&'a self, name: &Name) -> Result<Reservation<'a>> {
        drop(self.admit(Ok(name))?);
        Ok(Reservation {
            plan: self,
            name: Some(name.clone()),
        })
    }

    /// As [`add_reserved`](Self::add_reserved), for a process whose type is not known.
    pub(crate) fn add_reserved_boxed(&self, plan: ProcessPlan) -> Result<ProcessId> {
        let id = plan.id();
        let mut members = self.members();
        if members.phase == Phase::Ended {
            drop(members);
            return Err(self.ended(plan.name()));
        }
        if members.running.is_some() {
            self.start_prepared(members, plan)?;
        } else {
            members.waiting.push(plan);
        }
        Ok(id)
    }

    /// Adds a process: to be started with the others, or at once if they run. O(1) but for what is the user's, and those that have ended meanwhile.
    pub(crate) fn add_process<B: Build>(&self, plan: ProcessPlan<B>) -> Result<ProcessId> {
        let id = plan.id();
        let members = self.admit(plan.own_name())?;
        self.add_admitted(members, plan, false)?;
        Ok(id)
    }

    /// As [`add_process`](Self::add_process), to a system that runs.
    pub(crate) fn start_process<B: Build>(&self, plan: ProcessPlan<B>) -> Result<ProcessHandle> {
        let mut members = self.admit(plan.own_name())?;
        if members.running.is_none() {
            if let Ok(name) = plan.own_name() {
                members.started.give_name_back(name);
            }
            drop(members);
            let process = plan.name().to_string();
            return Err(SetupError::NotRunning { process }.into());
        }
        match self.add_admitted(members, plan, true)? {
            Some(handle) => Ok(handle),
            None => unreachable!("the system runs"),
        }
    }

    /// As [`add_process`](Self::add_process), for one whose name is [reserved](Self::reserve).
    pub(crate) fn add_reserved<B: Build>(&self, plan: ProcessPlan<B>) -> Result<ProcessId> {
        let id = plan.id();
        let members = self.members();
        if members.phase == Phase::Ended {
            drop(members);
            return Err(self.ended(plan.name()));
        }
        self.add_admitted(members, plan, false)?;
        Ok(id)
    }

    /// Gives the handle of a process that starts at once, if it is `wanted`.
    fn add_admitted<B: Build>(
        &self,
        mut members: MutexGuard<'_, Members>,
        plan: ProcessPlan<B>,
        wanted: bool,
    ) -> Result<Option<ProcessHandle>> {
        let id = plan.id();
        let Members {
            running: Some(running),
            started,
            ..
        } = &mut *members
        else {
            members.waiting.push(plan.boxed());
            return Ok(None);
        };
        let Place::Executor(number) = plan.place else {
            return self.start_prepared(members, plan.boxed()).map(Some);
        };
        let Prepared { resident, build } = plan.prepared;
        if resident.is_some() {
            return self
                .start_prepared(
                    members,
                    ProcessPlan {
                        prepared: Prepared { resident, build },
                        ..plan
                    }
                    .boxed(),
                )
                .map(Some);
        }
        // The lock is kept from the look at the phase until it is entered: the end cannot come in between.
        let (mut member, mut announced, frame) =
            running.announce(number, plan.spec, plan.ledger, None);
        member.is_late = true;
        member.shares_name = plan.shares_name;
        started.enter(id, member, &running.common.emergency);
        let handle = wanted.then(|| announced.handle());
        if announced.is_built_here() {
            // The executor is in a process' turn, so it does not end meanwhile.
            drop(members);
            drop(start(build, announced, frame));
        } else {
            let refused = start(build, announced, frame);
            drop(members);
            drop(refused);
        }
        Ok(handle)
    }

    /// Takes the `name` of a process to be, if it has one of its own, and if there can be one.
    fn admit(&self, name: Result<&Name, &Name>) -> Result<MutexGuard<'_, Members>> {
        let mut guard = self.members();
        let members = &mut *guard;
        if members.phase == Phase::Ended {
            let (Ok(name) | Err(name)) = name;
            drop(guard);
            return Err(self.ended(name));
        }
        if let Some(running) = &members.running {
            let Common {
                living, emergency, ..
            } = &*running.common;
            members.started.note_ends(living, emergency);
        }
        if let Ok(name) = name
            && !members.started.take_name(name)
        {
            // Who had it may have ended, and others may know that, though its executor has not told of it yet.
            if let Some(running) = &members.running {
                members.started.look_for_ends(&running.common.emergency);
            }
            if !members.started.take_name(name) {
                return Err(duplicate("process", name));
            }
        }
        Ok(guard)
    }

    /// Starts a process that takes longer, beside those that run.
    fn start_prepared(
        &self,
        members: MutexGuard<'_, Members>,
        plan: ProcessPlan,
    ) -> Result<ProcessHandle> {
        let (name, shares_name) = (plan.name().clone(), plan.shares_name);
        let Some(running) = members.running.clone() else {
            drop(members);
            return Err(self.ended(&name));
        };
        self.start_late(members, &running, plan, &name)
            .inspect_err(|_| {
                // It never was, so it may be tried again.
                if !shares_name {
                    self.members().started.give_name_back(&name);
                }
            })
    }

    /// Forgets a process that has ended before it was entered: its end is told before that.
    fn never_entered(&self, running: &Running, id: ProcessId) {
        let Common {
            living, emergency, ..
        } = &*running.common;
        let mut members = self.members();
        members.started.note_ends(living, emergency);
        members.started.never_entered(id);
    }

    /// Starts a process beside those that run. Its `pre_run` and its thread's start happen without the lock: they may take long, and spawn.
    fn start_late<'a>(
        &'a self,
        mut members: MutexGuard<'a, Members>,
        running: &Running,
        mut plan: ProcessPlan,
        name: &str,
    ) -> Result<ProcessHandle> {
        let id = plan.id();
        let _clock = running.common.clock.enter();
        let _log = running.common.log.enter();
        if let Some(resident) = &mut plan.prepared.resident {
            drop(members);
            let _scope = running.common.scope.clone().enter_to_prepare();
            let declared = plan.spec.name();
            self.parameters
                .declaring(id, declared, || prepare(&mut **resident))
                .map_err(|error| error.in_process(name))?;
            members = self.members();
        }
        let on_thread = matches!(plan.place, Place::Thread { .. });
        if on_thread {
            if running.simulation.is_none() {
                let places = &members.places;
                neighbours::join(&mut plan, &running.executors, places, &members.threads);
            }
            drop(members);
        } else if members.phase == Phase::Ended {
            // On an executor the lock is kept from the look at the phase until it is entered: the end cannot come in between.
            drop(members);
            clean_up(plan.prepared.resident);
            return Err(self.ended(name));
        } else {
            // Nothing of the user's runs there.
            return match running.start(plan) {
                Ok((member, Started::OnExecutor(mut pending))) => {
                    let handle = member.handle.clone();
                    members.enter_late(id, member, running);
                    if pending.is_built_here() {
                        // The executor is in a process' turn, so it does not end meanwhile.
                        drop(members);
                        drop(pending.hand_over());
                    } else {
                        let refused = pending.hand_over();
                        drop(members);
                        drop(refused);
                    }
                    Ok(handle)
                }
                Ok((_, Started::OnThread(_))) => unreachable!("its place is an executor"),
                Err(refused) => {
                    drop(members);
                    Err(refused.clean_up())
                }
            };
        }
        let (mut member, thread) = match running.start(plan) {
            Ok((member, Started::OnThread(thread))) => (member, thread),
            Ok((_, Started::OnExecutor(_))) => unreachable!("its place is a thread"),
            Err(refused) => {
                self.never_entered(running, id);
                return Err(refused.clean_up());
            }
        };
        // The thread is held until the system is known to run still.
        let mut members = self.members();
        if members.phase == Phase::Ended {
            drop(members);
            // Its body ends before it began.
            drop(thread);
            self.never_entered(running, id);
            clean_up(member.take_resident());
            return Err(self.ended(name));
        }
        let handle = member.handle.clone();
        members.enter_late(id, member, running);
        thread.1.release();
        members.threads.push(thread);
        Ok(handle)
    }

    fn ended(&self, process: &str) -> Error {
        SetupError::Ended {
            system: self.name.clone(),
            process: process.to_owned(),
        }
        .into()
    }

    /// The name of a process that was started and is remembered.
    pub(crate) fn process_name(&self, id: ProcessId) -> Option<String> {
        self.members().started.name(id).map(str::to_owned)
    }

    pub(crate) fn process_handle(&self, id: ProcessId) -> Option<ProcessHandle> {
        self.members().started.handle(id)
    }
}
