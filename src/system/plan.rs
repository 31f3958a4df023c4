//! What a system is to be, and what it has become: shared by its handles.

use super::clock::ClockPlan;
use super::neighbours;
use super::register::Register;
use crate::csp::composition::{ThreadKind, ThreadPart};
use crate::csp::process::{Common, Frame, Phases, Prepared, Start, Verdict, clean_up, prepare};
use crate::csp::tree::Tree;
use crate::error::{Error, Result, SetupError};
use crate::record::TapePlan;
use crate::report::Report;
use crate::safety::{Function, Ledger};
use luna_executors::{
    Announced, ExecutorHandle, OsThread, ProcessHandle, ProcessSpec, Refused, SimulationHandle,
    Standstill,
};
use luna_platform::current::ProcessId;
use luna_platform::thread::{Attributes, Mode};
use std::collections::HashSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A system's plan. Its locks are for the set-up, the end, and the non-real-time side.
pub(crate) struct Plan {
    name: String,
    settings: Mutex<Settings>,
    members: Mutex<Members>,
    tree: Arc<Tree>,
}

#[derive(Default)]
pub(crate) struct Settings {
    pub(crate) strict: bool,
    pub(crate) lock_memory: bool,
    pub(crate) max_loops: Option<usize>,
    /// Of how many that have ended more than their number is known.
    pub(crate) remembered: Option<usize>,
    pub(crate) functions: Vec<Function>,
    pub(crate) clock: ClockPlan,
    pub(crate) tapes: TapePlan,
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

/// A process to be.
pub(crate) struct ProcessPlan {
    pub(crate) name: Arc<str>,
    pub(crate) id: ProcessId,
    pub(crate) place: Place,
    pub(crate) spec: ProcessSpec,
    pub(crate) ledger: Option<Arc<Ledger>>,
    pub(crate) prepared: Prepared,
}

/// A process that was started.
pub(crate) struct Member {
    pub(crate) name: Arc<str>,
    pub(crate) handle: ProcessHandle,
    pub(crate) verdict: Arc<Verdict>,
    pub(crate) ledger: Option<Arc<Ledger>>,
    pub(crate) resident: Option<Box<dyn Phases>>,
    /// Its place in the order of starts.
    pub(crate) order: u64,
    /// It was spawned while the system ran.
    pub(crate) is_late: bool,
    pub(crate) has_failed: bool,
    /// Its end was noted.
    pub(crate) buried: bool,
    pub(crate) on: On,
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

    /// Starts a prepared process: on a thread, which is held; on an executor once it is handed over.
    pub(crate) fn start(&self, plan: ProcessPlan) -> Result<(Member, Started), NotStarted> {
        let ProcessPlan {
            name,
            place,
            mut spec,
            ledger,
            prepared: Prepared { resident, starter },
            ..
        } = plan;
        let common = &self.common;
        let frame = Frame::new(common.clone(), &name);
        let verdict = frame.verdict.clone();
        if let Some(ledger) = &ledger {
            ledger.join(&common.emergency, &common.living);
        }
        spec = spec.listed();
        if resident.is_none() && ledger.is_none() {
            spec = spec.unhurried();
        }
        let (handle, started, on) = match place {
            Place::Executor(number) => {
                let announced = self.executors[number].announce(spec);
                let pending = Pending {
                    announced,
                    starter,
                    frame,
                };
                (
                    pending.announced.handle(),
                    Started::OnExecutor(pending),
                    On::Executor(number),
                )
            }
            Place::Thread {
                name: thread_name,
                attributes,
            } => {
                match starter.on_thread(
                    (*attributes).mode(self.mode),
                    spec,
                    self.simulation.as_ref(),
                    frame,
                ) {
                    Ok(thread) => {
                        let part = ThreadPart::obtained(
                            &thread_name,
                            ThreadKind::OsThread,
                            thread.obtained(),
                        );
                        (
                            thread.process().clone(),
                            Started::OnThread((thread_name, thread)),
                            On::Thread(Box::new(part)),
                        )
                    }
                    Err(error) => {
                        return Err(NotStarted {
                            error: Error::not_started(&name, error),
                            resident,
                        });
                    }
                }
            }
        };
        let member = Member {
            name,
            handle,
            verdict,
            ledger,
            resident,
            order: 0,
            is_late: false,
            has_failed: false,
            buried: false,
            on,
        };
        Ok((member, started))
    }
}

#[derive(Default)]
pub(crate) struct Members {
    pub(crate) phase: Phase,
    pub(crate) executors: Vec<ExecutorPlan>,
    /// The executors that were started, as parts of the system.
    pub(crate) places: Vec<ThreadPart>,
    pub(crate) waiting: Vec<ProcessPlan>,
    pub(crate) started: Register,
    pub(crate) threads: Vec<NamedThread>,
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

fn duplicate(kind: &'static str, name: &str) -> Error {
    SetupError::DuplicateName {
        kind,
        name: name.to_owned(),
    }
    .into()
}

impl Plan {
    pub(crate) fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            settings: Mutex::default(),
            members: Mutex::default(),
            tree: Tree::new(),
        }
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// The named sub-processes.
    pub(crate) fn tree(&self) -> &Arc<Tree> {
        &self.tree
    }

    pub(crate) fn settings(&self) -> MutexGuard<'_, Settings> {
        self.settings.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn members(&self) -> MutexGuard<'_, Members> {
        self.members.lock().unwrap_or_else(PoisonError::into_inner)
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

    /// Adds a process: to be started with the others, or at once if they run. O(1) but for what is the user's, and those that have ended meanwhile.
    pub(crate) fn add_process(&self, plan: ProcessPlan) -> Result<ProcessId> {
        let id = plan.id;
        let mut members = self.members();
        if members.phase == Phase::Ended {
            return Err(self.ended(&plan.name));
        }
        let running = members.running.clone();
        if let Some(running) = &running {
            let Common {
                living, emergency, ..
            } = &*running.common;
            members.started.note_ends(living, emergency);
        }
        if !members.started.take_name(&plan.name) {
            return Err(duplicate("process", &plan.name));
        }
        let Some(running) = running else {
            members.waiting.push(plan);
            return Ok(id);
        };
        let name = plan.name.clone();
        self.start_late(members, &running, plan, &name)
            .inspect_err(|_| {
                // It never was, so it may be tried again.
                self.members().started.give_name_back(&name);
            })?;
        Ok(id)
    }

    /// Starts a process beside those that run. Its `pre_run` and its thread's start happen without the lock: they may take long, and spawn.
    /// Forgets a process that has ended before it was entered: its end is told before that.
    fn never_entered(&self, running: &Running, id: ProcessId) {
        let Common {
            living, emergency, ..
        } = &*running.common;
        let mut members = self.members();
        members.started.note_ends(living, emergency);
        members.started.never_entered(id);
    }

    fn start_late<'a>(
        &'a self,
        mut members: MutexGuard<'a, Members>,
        running: &Running,
        mut plan: ProcessPlan,
        name: &str,
    ) -> Result<()> {
        let id = plan.id;
        let _clock = running.common.clock.enter();
        if let Some(resident) = &mut plan.prepared.resident {
            drop(members);
            prepare(&mut **resident).map_err(|error| error.in_process(name))?;
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
                    Ok(())
                }
                Ok((_, Started::OnThread(_))) => unreachable!("its place is an executor"),
                Err(refused) => {
                    drop(members);
                    Err(refused.clean_up())
                }
            };
        }
        let (member, thread) = match running.start(plan) {
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
            clean_up(member.resident);
            return Err(self.ended(name));
        }
        members.enter_late(id, member, running);
        thread.1.release();
        members.threads.push(thread);
        Ok(())
    }

    fn ended(&self, process: &str) -> Error {
        SetupError::Ended {
            system: self.name.clone(),
            process: process.to_owned(),
        }
        .into()
    }

    pub(crate) fn process_handle(&self, id: ProcessId) -> Option<ProcessHandle> {
        self.members().started.handle(id)
    }
}
