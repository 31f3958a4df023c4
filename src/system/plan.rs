//! What a system is to be, and what it has become: shared by its handles.

use super::neighbours;
use crate::csp::composition::{ThreadKind, ThreadPart};
use crate::csp::process::{Frame, Phases, Prepared, Verdict, clean_up, prepare};
use crate::csp::tree::Tree;
use crate::error::{Error, Result, SetupError};
use crate::report::Report;
use crate::safety::{Emergency, Function, Ledger};
use crate::time::Scope;
use luna_executors::{ExecutorHandle, Living, OsThread, ProcessHandle, ProcessSpec};
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
    pub(crate) functions: Vec<Function>,
}

/// Where a process is to run.
pub(crate) enum Place {
    /// The executor with this number.
    Executor(usize),
    /// A thread of its own.
    Thread {
        name: String,
        attributes: Attributes,
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
    pub(crate) name: String,
    pub(crate) id: ProcessId,
    pub(crate) place: Place,
    pub(crate) spec: ProcessSpec,
    pub(crate) ledger: Option<Arc<Ledger>>,
    pub(crate) prepared: Prepared,
}

/// A process that was started, until it is buried.
pub(crate) struct Member {
    pub(crate) name: String,
    pub(crate) id: ProcessId,
    pub(crate) handle: ProcessHandle,
    pub(crate) verdict: Arc<Verdict>,
    pub(crate) ledger: Option<Arc<Ledger>>,
    pub(crate) resident: Option<Box<dyn Phases>>,
    pub(crate) error: Option<Error>,
    pub(crate) buried: bool,
    pub(crate) on: On,
}

/// Where a process was started.
#[derive(Clone)]
pub(crate) enum On {
    /// The executor with this number.
    Executor(usize),
    /// A thread of its own.
    Thread(ThreadPart),
}

/// What processes are started with while the system runs.
#[derive(Clone)]
pub(crate) struct Running {
    pub(crate) executors: Vec<ExecutorHandle>,
    pub(crate) living: Arc<Living>,
    pub(crate) scope: Arc<Scope>,
    pub(crate) emergency: Arc<Emergency>,
    pub(crate) mode: Mode,
    pub(crate) tree: Arc<Tree>,
}

/// An OS thread with its name.
pub(crate) type NamedThread = (String, OsThread);

/// A process that could not be started, and what is left of it to clean up.
pub(crate) struct NotStarted {
    pub(crate) error: Error,
    pub(crate) resident: Option<Box<dyn Phases>>,
}

impl Running {
    /// Whether there is nothing more to wait for: all processes have ended, and an emergency, if there is one, is over.
    pub(crate) fn is_over(&self) -> bool {
        self.emergency.is_safe() || self.living.count() == 0 && !self.emergency.has_begun()
    }

    pub(crate) fn frame(&self) -> Frame {
        Frame {
            verdict: Verdict::new(),
            scope: self.scope.clone(),
            emergency: self.emergency.clone(),
            tree: self.tree.clone(),
        }
    }

    /// Starts a prepared process. On an executor that is held it does not run yet; a thread is held too.
    pub(crate) fn start(
        &self,
        plan: ProcessPlan,
    ) -> Result<(Member, Option<NamedThread>), NotStarted> {
        let ProcessPlan {
            name,
            id,
            place,
            spec,
            ledger,
            prepared: Prepared { resident, starter },
        } = plan;
        let frame = self.frame();
        let verdict = frame.verdict.clone();
        if let Some(ledger) = &ledger {
            ledger.join(&self.emergency, &self.living);
        }
        let (handle, thread, on) = match place {
            Place::Executor(number) => (
                starter.on_executor(&self.executors[number], spec, frame),
                None,
                On::Executor(number),
            ),
            Place::Thread {
                name: thread_name,
                attributes,
            } => {
                match starter.on_thread(
                    attributes.mode(self.mode),
                    spec,
                    self.living.clone(),
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
                            Some((thread_name, thread)),
                            On::Thread(part),
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
        Ok((
            Member {
                name,
                id,
                handle,
                verdict,
                ledger,
                resident,
                error: None,
                buried: false,
                on,
            },
            thread,
        ))
    }
}

#[derive(Default)]
pub(crate) struct Members {
    pub(crate) phase: Phase,
    pub(crate) executors: Vec<ExecutorPlan>,
    /// The executors that were started, as parts of the system.
    pub(crate) places: Vec<ThreadPart>,
    pub(crate) waiting: Vec<ProcessPlan>,
    pub(crate) started: Vec<Member>,
    pub(crate) threads: Vec<NamedThread>,
    pub(crate) running: Option<Running>,
    /// Of the run that has ended.
    pub(crate) report: Option<Report>,
    names: HashSet<(&'static str, String)>,
}

#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Phase {
    #[default]
    Described,
    Running,
    Ended,
}

impl Members {
    /// Takes a name of its kind.
    fn take_name(&mut self, kind: &'static str, name: &str) -> Result<()> {
        if !self.names.insert((kind, name.to_owned())) {
            return Err(SetupError::DuplicateName {
                kind,
                name: name.to_owned(),
            }
            .into());
        }
        Ok(())
    }
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

    /// Adds an executor; gives its number.
    pub(crate) fn add_executor(&self, executor: ExecutorPlan) -> Result<usize> {
        let mut members = self.members();
        if members.phase != Phase::Described {
            return Err(SetupError::AlreadyRun {
                system: self.name.clone(),
            }
            .into());
        }
        members.take_name("executor", &executor.name)?;
        members.executors.push(executor);
        Ok(members.executors.len() - 1)
    }

    /// Takes the name of an OS thread, which executors share.
    pub(crate) fn take_thread_name(&self, name: &str) -> Result<()> {
        self.members().take_name("executor", name)
    }

    /// Adds a process: to be started with the others, or at once if they run.
    pub(crate) fn add_process(&self, plan: ProcessPlan) -> Result<ProcessId> {
        let id = plan.id;
        let running = {
            let mut members = self.members();
            if members.phase == Phase::Ended {
                return Err(self.ended(plan.name));
            }
            members.take_name("process", &plan.name)?;
            match &members.running {
                None => {
                    members.waiting.push(plan);
                    return Ok(id);
                }
                Some(running) => running.clone(),
            }
        };
        let name = plan.name.clone();
        self.start_late(&running, plan).inspect_err(|_| {
            // It never was, so it may be tried again.
            self.members().names.remove(&("process", name));
        })?;
        Ok(id)
    }

    /// Starts a process beside those that run. Its `pre_run` and its thread's start happen without the lock: they may take long, and spawn.
    fn start_late(&self, running: &Running, mut plan: ProcessPlan) -> Result<()> {
        let name = plan.name.clone();
        if let Some(resident) = &mut plan.prepared.resident {
            prepare(&mut **resident).map_err(|error| error.in_process(&name))?;
        }
        let started = match plan.place {
            // Nothing of the user's runs here, so the lock is kept from the look at the phase to the start: the end cannot come in between.
            Place::Executor(_) => {
                let mut members = self.members();
                if members.phase == Phase::Ended {
                    drop(members);
                    Err(NotStarted {
                        error: self.ended(name),
                        resident: plan.prepared.resident,
                    })
                } else {
                    running
                        .start(plan)
                        .map(|(member, _)| members.started.push(member))
                }
            }
            // The thread is held until the system is known to run still.
            Place::Thread { .. } => {
                let members = self.members();
                let places = &members.places;
                neighbours::join(&mut plan, &running.executors, places, &members.threads);
                drop(members);
                running.start(plan).and_then(|(member, thread)| {
                    let mut members = self.members();
                    if members.phase == Phase::Ended {
                        drop(members);
                        // Its body ends before it began.
                        drop(thread);
                        return Err(NotStarted {
                            error: self.ended(name),
                            resident: member.resident,
                        });
                    }
                    members.started.push(member);
                    if let Some((_, thread)) = &thread {
                        thread.release();
                    }
                    members.threads.extend(thread);
                    Ok(())
                })
            }
        };
        started.map_err(|NotStarted { error, resident }| {
            clean_up(resident);
            error
        })
    }

    fn ended(&self, process: String) -> Error {
        SetupError::Ended {
            system: self.name.clone(),
            process,
        }
        .into()
    }

    pub(crate) fn process_handle(&self, id: ProcessId) -> Option<ProcessHandle> {
        self.members()
            .started
            .iter()
            .find(|member| member.id == id)
            .map(|member| member.handle.clone())
    }
}
