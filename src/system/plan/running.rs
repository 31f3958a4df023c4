//! How a process is started where the system runs.

use super::{Placement, ProcessPlan};
use crate::csp::composition::{ThreadKind, ThreadPart};
use crate::csp::process::{Common, Phases, Prepared};
use crate::error::Error;
use crate::safety::Ledger;
use luna_core::{Announced, ExecutorHandle, OsThread, ProcessHandle, SimulationHandle, Standstill};
use luna_machine::memory::copy_words;
use luna_platform::thread::Mode;
use std::sync::Arc;

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

/// What comes of a process that is started.
pub(crate) enum Started {
    OnExecutor(Announced),
    OnThread(NamedThread),
}

impl Running {
    /// Whether there is nothing more to wait for: all processes have ended or time does not go on,
    /// and an emergency, if there is one, is over.
    pub(crate) fn is_over(&self) -> bool {
        let emergency = &self.common.emergency;
        let has_none = || self.common.registry.count() == 0 || self.standstill().is_some();
        emergency.is_safe() || !emergency.has_begun() && has_none()
    }

    /// Whether a deadlock is an emergency that ends the run. On a virtual clock nothing else would:
    /// no time passes in which a thread outside could come.
    pub(crate) fn ends_at_deadlock(&self) -> bool {
        self.mode == Mode::Strict || self.simulation.is_some()
    }

    /// Why time does not go on, if it does not.
    pub(crate) fn standstill(&self) -> Option<Standstill> {
        self.simulation.as_ref()?.standstill()
    }

    /// Starts a prepared process: on a thread, which is held; on an executor once it is handed
    /// over. No user code runs there.
    pub(crate) fn start(&self, plan: ProcessPlan) -> Result<(Member, Started), NotStarted> {
        let attributes = match plan.place {
            Placement::Thread(attributes) => (*attributes).mode(self.mode),
            Placement::Executor(number) => {
                let (member, announced) = self.announce(number, plan);
                return Ok((member, Started::OnExecutor(announced)));
            }
        };
        let common = &self.common;
        let Prepared { resident, start } = plan.prepared;
        if let Some(ledger) = &plan.ledger {
            ledger.join(&common.emergency, &common.registry);
        }
        let spec = common.replay_logs.give_log(plan.spec.listed());
        let name = spec.name().to_string();
        let thread_name = attributes.name().to_owned();
        let announce = |executor: &_| start.announce(executor, spec, common);
        let started = match &self.simulation {
            None => OsThread::start_counted(attributes, common.registry.clone(), announce),
            Some(simulation) => Ok(OsThread::start_simulated(simulation, &attributes, announce)),
        };
        let thread = match started {
            Ok(thread) => thread,
            Err(error) => {
                let error = Error::not_started(&name, error);
                return Err(NotStarted { error, resident });
            }
        };
        let part = ThreadPart::obtained(&thread_name, ThreadKind::OsThread, thread.obtained());
        let on = On::Thread(Box::new(part));
        let mut member = Member::new(thread.process().clone(), on, plan.ledger, resident);
        member.shares_name = plan.shares_name;
        Ok((member, Started::OnThread((thread_name, thread))))
    }

    /// Announces a prepared process on the executor of this number. No user code runs there.
    pub(super) fn announce(&self, number: usize, plan: ProcessPlan) -> (Member, Announced) {
        let common = &self.common;
        let Prepared { resident, start } = plan.prepared;
        let mut spec = common.replay_logs.give_log(plan.spec.listed());
        match &plan.ledger {
            Some(ledger) => ledger.join(&common.emergency, &common.registry),
            None if resident.is_none() => spec = spec.unhurried(),
            None => {}
        }
        let (announced, handle) = start.announce(&self.executors[number], spec, common);
        let mut member = Member::new(handle, On::Executor(number), plan.ledger, resident);
        member.shares_name = plan.shares_name;
        (member, announced)
    }
}

/// A process that was started.
pub(crate) struct Member {
    pub(crate) handle: ProcessHandle,
    pub(crate) on: On,
    pub(crate) ledger: Option<Arc<Ledger>>,
    pub(crate) resident: Option<Box<dyn Phases>>,
    /// Its place in the order of starts.
    pub(crate) order: u32,
    pub(crate) shares_name: bool,
    /// It was spawned while the system ran.
    pub(crate) is_late: bool,
    /// Its end was noted.
    pub(crate) is_reaped: bool,
    pub(crate) has_failed: bool,
}

impl Member {
    pub(in crate::system) fn new(
        handle: ProcessHandle,
        on: On,
        ledger: Option<Arc<Ledger>>,
        resident: Option<Box<dyn Phases>>,
    ) -> Self {
        Self {
            handle,
            on,
            ledger,
            resident,
            order: 0,
            shares_name: false,
            is_late: false,
            is_reaped: false,
            has_failed: false,
        }
    }

    pub(crate) fn name(&self) -> &str {
        self.handle.name()
    }

    /// Whether it need not be remembered when it has ended.
    pub(in crate::system) fn may_be_forgotten(&self) -> bool {
        self.is_late && matches!(self.on, On::Executor(_))
    }

    /// The machine words of the process' own memory, some of which are addresses: a hint for
    /// reports. What it holds behind a box is not among them, and what it has given away may still
    /// be.
    pub(crate) fn words(&self) -> Vec<usize> {
        let body = self.handle.addresses_of_body();
        let mut words = body.map(copy_words).unwrap_or_default();
        if let Some(resident) = &self.resident {
            words.extend(resident.words());
        }
        words
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
