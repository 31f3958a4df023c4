//! What a system is to be, and what it has become: shared by its handles.

use crate::csp::process::{Frame, Phases, Prepared, Verdict};
use crate::error::{Error, Result, SetupError};
use crate::safety::{Emergency, Function};
use crate::time::Scope;
use luna_executors::{ExecutorHandle, Living, OsThread, ProcessHandle, ProcessSpec};
use luna_platform::current::ProcessId;
use luna_platform::thread::Attributes;
use std::collections::HashSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A system's plan. Its locks are for the set-up, the end, and the non-real-time side.
pub(crate) struct Plan {
    name: String,
    settings: Mutex<Settings>,
    members: Mutex<Members>,
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
    Thread(Attributes),
}

/// An executor to be.
pub(crate) struct ExecutorPlan {
    pub(crate) name: String,
    pub(crate) attributes: Attributes,
}

/// A process to be.
pub(crate) struct ProcessPlan {
    pub(crate) name: String,
    pub(crate) id: ProcessId,
    pub(crate) place: Place,
    pub(crate) spec: ProcessSpec,
    pub(crate) prepared: Prepared,
}

/// A process that was started, until it is buried.
pub(crate) struct Member {
    pub(crate) name: String,
    pub(crate) id: ProcessId,
    pub(crate) handle: ProcessHandle,
    pub(crate) verdict: Arc<Verdict>,
    pub(crate) resident: Option<Box<dyn Phases>>,
    pub(crate) error: Option<Error>,
    pub(crate) buried: bool,
}

/// What processes are started with while the system runs.
#[derive(Clone)]
pub(crate) struct Running {
    pub(crate) executors: Vec<ExecutorHandle>,
    pub(crate) living: Arc<Living>,
    pub(crate) scope: Arc<Scope>,
    pub(crate) emergency: Arc<Emergency>,
}

impl Running {
    pub(crate) fn frame(&self) -> Frame {
        Frame { verdict: Verdict::new(), scope: self.scope.clone(), emergency: self.emergency.clone() }
    }

    /// Starts a prepared process. On an executor that is held it does not run yet; a thread is held too.
    pub(crate) fn start(&self, plan: ProcessPlan) -> Result<(Member, Option<OsThread>)> {
        let ProcessPlan { name, id, place, spec, prepared: Prepared { resident, starter } } = plan;
        let frame = self.frame();
        let verdict = frame.verdict.clone();
        let (handle, thread) = match place {
            Place::Executor(number) => (starter.on_executor(&self.executors[number], spec, frame), None),
            Place::Thread(attributes) => {
                let thread = starter
                    .on_thread(attributes, spec, self.living.clone(), frame)
                    .map_err(|error| Error::not_started(&name, error));
                match thread {
                    Ok(thread) => (thread.process().clone(), Some(thread)),
                    Err(error) => {
                        if let Some(mut resident) = resident {
                            resident.post_run();
                        }
                        return Err(error);
                    }
                }
            }
        };
        Ok((Member { name, id, handle, verdict, resident, error: None, buried: false }, thread))
    }
}

#[derive(Default)]
pub(crate) struct Members {
    pub(crate) phase: Phase,
    pub(crate) executors: Vec<ExecutorPlan>,
    pub(crate) waiting: Vec<ProcessPlan>,
    pub(crate) started: Vec<Member>,
    pub(crate) threads: Vec<(String, OsThread)>,
    pub(crate) running: Option<Running>,
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
            return Err(SetupError::DuplicateName { kind, name: name.to_owned() }.into());
        }
        Ok(())
    }
}

impl Plan {
    pub(crate) fn new(name: &str) -> Self {
        Self { name: name.to_owned(), settings: Mutex::default(), members: Mutex::default() }
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
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
            return Err(SetupError::AlreadyRun { system: self.name.clone() }.into());
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
    pub(crate) fn add_process(&self, mut plan: ProcessPlan) -> Result<ProcessId> {
        let id = plan.id;
        let running = {
            let mut members = self.members();
            if members.phase == Phase::Ended {
                return Err(SetupError::Ended { system: self.name.clone(), process: plan.name }.into());
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
        // Without the lock: it may take long, and spawn.
        if let Some(resident) = &mut plan.prepared.resident {
            resident.pre_run().map_err(|error| error.in_process(&plan.name))?;
        }
        let name = plan.name.clone();
        let (member, thread) = running.start(plan)?;
        let mut members = self.members();
        members.started.push(member);
        if let Some(thread) = thread {
            thread.release();
            members.threads.push((name, thread));
        }
        Ok(id)
    }

    pub(crate) fn process_handle(&self, id: ProcessId) -> Option<ProcessHandle> {
        self.members().started.iter().find(|member| member.id == id).map(|member| member.handle.clone())
    }
}
