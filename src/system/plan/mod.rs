//! What a system is to be, and what it has become: shared by its handles.

mod admission;
mod running;
use super::clock::ClockPlan;
use super::register::Register;
use super::stand_in::StandIns;
use crate::csp::composition::ThreadPart;
use crate::csp::process::Prepared;
use crate::csp::tree::Tree;
use crate::error::{Error, Result, SetupError};
use crate::log::{Asked, Log};
use crate::notice::notice;
use crate::report::Report;
use crate::safety::{Emergency, Guardian, Ledger};
use crate::time::{Manager, StampState};
use luna_config::deployment::{self, Deployment};
use luna_config::file;
use luna_config::parameters::Store;
use luna_core::current::ProcessId;
use luna_core::{Name, ProcessSpec};
use luna_platform::thread::Attributes;
use luna_replay::session::SessionPlan;
pub(crate) use running::{Member, NamedThread, NotStarted, On, Running, Started};
use std::collections::HashSet;
use std::panic::{AssertUnwindSafe, RefUnwindSafe, UnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

/// A system's plan. Its locks are for the set-up, the end, and the non-real-time side.
pub(crate) struct Plan {
    name: String,
    settings: Mutex<Settings>,
    members: Mutex<Members>,
    stand_ins: Mutex<StandIns>,
    /// No process can be replaced any more.
    stand_ins_closed: AtomicBool,
    #[cfg(unix)]
    pub(crate) devices: Arc<luna_devices::Devices>,
    pub(crate) tree: Arc<Tree>,
    pub(crate) emergency: Arc<Emergency>,
    pub(crate) parameters: Arc<Store>,
    /// The system file, if there is one; decided when the first executor or thread is made.
    deployment: OnceLock<Option<Arc<Deployment>>>,
    pub(crate) log: Log,
    /// A call of the set-up, or of `run`, has returned an error.
    pub(crate) was_refused: AtomicBool,
}

// No user code runs under its locks, and what they guard is whole between two statements. So code
// that catches a panic finds the system as it was, or as it ended: described, with or without the
// process that panicked as it was made, or run.
impl UnwindSafe for Plan {}
impl RefUnwindSafe for Plan {}

#[derive(Default)]
pub(crate) struct Settings {
    pub(crate) strict: bool,
    pub(crate) lock_memory: bool,
    pub(crate) max_loops: Option<usize>,
    /// The manager that wakes the loops, if their executors do not.
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
    /// The clock of stamps that was stated, and how good it was then.
    pub(crate) stamps: Option<StampState>,
    /// What is to be recorded.
    pub(crate) logging: Asked,
    /// The addresses of a system that is to be found by other programs.
    pub(crate) announced: Option<Vec<(String, String)>>,
    pub(crate) replay_logs: SessionPlan,
    /// Recordings may replace files.
    pub(crate) replaces: bool,
    /// How often to look whether the file of parameters has changed.
    pub(crate) look_at_parameters: Option<Duration>,
    /// How many turns may be taken at one instant of a virtual clock; as many as stated.
    pub(crate) most_turns: Option<u64>,
}

#[derive(Default)]
pub(crate) struct Members {
    pub(crate) phase: Phase,
    pub(crate) executors: Vec<Attributes>,
    /// The executors that were started, as parts of the system.
    pub(crate) places: Vec<ThreadPart>,
    pub(crate) waiting: Vec<ProcessPlan>,
    /// Before the processes that were started: dropping a thread waits for its body, which refers
    /// to its process.
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

impl Members {
    /// Takes the name of an executor or a thread.
    fn take_thread_name(&mut self, name: &str) -> Result<()> {
        if !self.thread_names.insert(name.to_owned()) {
            return Err(duplicate("executor", name));
        }
        Ok(())
    }

    /// Gives back the names of a process that never was, so that it may be tried again.
    fn give_back(&mut self, names: &Names) {
        if let Some(name) = &names.process {
            self.started.give_name_back(name);
        }
        if let Some(name) = &names.thread {
            self.thread_names.remove(name);
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
        Arc::new_cyclic(|plan| {
            let emergency = Emergency::new(plan.clone());
            Self {
                name: name.to_owned(),
                settings: Mutex::default(),
                members: Mutex::default(),
                stand_ins: Mutex::default(),
                stand_ins_closed: AtomicBool::new(false),
                #[cfg(unix)]
                devices: luna_devices::Devices::new(emergency.clone()),
                tree: Tree::new(),
                emergency,
                parameters: Store::new(name),
                deployment: OnceLock::new(),
                log: Log::new(name),
                was_refused: AtomicBool::new(false),
            }
        })
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    pub(crate) fn settings(&self) -> MutexGuard<'_, Settings> {
        self.settings.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn stand_ins(&self) -> MutexGuard<'_, StandIns> {
        self.stand_ins
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// When the system starts: every stand-in must have found the process that it replaces.
    pub(crate) fn close_stand_ins(&self) -> Result<()> {
        self.stand_ins().close()?;
        self.stand_ins_closed.store(true, Ordering::Release);
        Ok(())
    }

    /// A process that is spawned without its ends cannot be replaced. While the system runs no
    /// stand-in waits to replace one.
    #[inline]
    pub(crate) fn check_plain(&self, process: &str) -> Result<()> {
        if self.stand_ins_closed.load(Ordering::Acquire) {
            return Ok(());
        }
        Ok(self.stand_ins().check_plain(process)?)
    }

    pub(crate) fn members(&self) -> MutexGuard<'_, Members> {
        self.members.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The system will not be run: drops what it was to consist of, which may hold the plan, unless
    /// it has been run. What is dropped is the user's: without a lock.
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
        // A program that has an error to report, or panics, ends because of that.
        let has_reason = self.was_refused.load(Ordering::Relaxed) || std::thread::panicking();
        if !waiting.is_empty() && !has_reason {
            notice!(
                "luna: system `{}` was dropped without `run`: none of its processes ({}) has run",
                self.name,
                waiting.len()
            );
        }
        for process in waiting {
            // One panic in a drop, which the hook reports, does not prevent the drop of the others.
            let _ = catch_unwind(AssertUnwindSafe(|| drop(process)));
        }
        let settings = std::mem::take(&mut *self.settings());
        drop(settings);
        self.emergency.conclude();
    }

    /// Reads the system file that the program names.
    pub(crate) fn read_deployment(&self, path: &Path) -> Result<()> {
        let too_late = || SetupError::DeploymentTooLate {
            system: self.name.clone(),
        };
        if self.deployment.get().is_some() {
            return Err(too_late().into());
        }
        let read = Some(Arc::new(Deployment::read(path, None)?));
        Ok(self.deployment.set(read).map_err(|_| too_late())?)
    }

    /// Decides whether there is a system file, before something is described: the program's, or
    /// that of the environment.
    pub(crate) fn begin_deployment(&self) -> Result<Option<&Deployment>> {
        if self.deployment.get().is_none() {
            let file = file::of_environment(deployment::VARIABLE);
            let read = file.map(|path| Deployment::read(&path, Some(&self.name)));
            let read = read.transpose()?;
            // Another thread that came first has read the same.
            let _ = self.deployment.set(read.map(Arc::new));
        }
        Ok(self.deployment().map(|deployment| &**deployment))
    }

    /// A thread is described, whose process may be spawned only while the system runs.
    pub(crate) fn enter_thread(&self, name: &str) {
        // What is wrong with the file is found again as its process is spawned.
        if let Ok(Some(deployment)) = self.begin_deployment() {
            deployment.enter_thread(name);
        }
    }

    /// The system file, if there is one.
    #[inline]
    pub(crate) fn deployment(&self) -> Option<&Arc<Deployment>> {
        self.deployment.get()?.as_ref()
    }

    /// A call of the set-up, or of `run`, returns an error.
    #[cold]
    pub(crate) fn note_refusal(&self) {
        self.was_refused.store(true, Ordering::Relaxed);
    }

    /// Whether the system has been run.
    pub(crate) fn has_begun(&self) -> bool {
        self.members().phase != Phase::Described
    }

    /// Adds an executor; gives its number.
    pub(crate) fn add_executor(&self, executor: Attributes) -> Result<usize> {
        let mut members = self.members();
        if members.phase != Phase::Described {
            return Err(SetupError::AlreadyRun {
                system: self.name.clone(),
            }
            .into());
        }
        members.take_thread_name(executor.name())?;
        if let Some(deployment) = self.deployment() {
            deployment.enter_executor(executor.name());
        }
        members.executors.push(executor);
        Ok(members.executors.len() - 1)
    }

    fn ended(&self, process: &str) -> Error {
        SetupError::Ended {
            system: self.name.clone(),
            process: process.to_owned(),
        }
        .into()
    }
}

/// Where a process is to run.
pub(crate) enum Placement {
    /// The executor with this number.
    Executor(usize),
    /// A thread of its own.
    Thread(Box<Attributes>),
}

impl Placement {
    /// The number of its executor, if it has no thread of its own.
    pub(crate) fn executor(&mut self) -> Option<&mut usize> {
        match self {
            Placement::Executor(number) => Some(number),
            Placement::Thread(_) => None,
        }
    }
}

/// A described process.
pub(crate) struct ProcessPlan {
    pub(crate) place: Placement,
    pub(crate) spec: ProcessSpec,
    /// Others may have its name too.
    pub(crate) shares_name: bool,
    pub(crate) ledger: Option<Arc<Ledger>>,
    pub(crate) prepared: Prepared,
}

/// The names that a process takes: they are given back if it is refused.
struct Names {
    /// Its own, unless it shares one.
    process: Option<Name>,
    /// That of its thread.
    thread: Option<String>,
}

impl ProcessPlan {
    fn names(&self) -> Names {
        Names {
            process: (!self.shares_name).then(|| self.spec.name().clone()),
            thread: self.thread_name().map(str::to_owned),
        }
    }

    /// The name of its own thread, if it has one.
    #[inline]
    fn thread_name(&self) -> Option<&str> {
        match &self.place {
            Placement::Executor(_) => None,
            Placement::Thread(attributes) => Some(attributes.name()),
        }
    }

    pub(crate) fn name(&self) -> &str {
        self.spec.name()
    }

    pub(crate) fn id(&self) -> ProcessId {
        self.spec.id()
    }
}
