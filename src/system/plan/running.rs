//! How a process is started where the system runs.

use super::described::{Placement, ProcessPlan};
use crate::csp::composition::{ThreadKind, ThreadPart};
use crate::csp::process::{Common, Frame, Phases, Prepared, clean_up};
use crate::error::Error;
use crate::safety::Ledger;
use luna_executors::{
    Announced, ExecutorHandle, OsThread, ProcessHandle, ProcessSpec, SimulationHandle, Standstill,
};
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

impl NotStarted {
    /// Cleans up what is left of it.
    pub(super) fn clean_up(self) -> Error {
        clean_up(self.resident);
        self.error
    }
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

    /// Announces a prepared process on an executor by `announce`. No user code runs there.
    pub(super) fn announce(
        &self,
        number: usize,
        mut spec: ProcessSpec,
        ledger: Option<Arc<Ledger>>,
        resident: Option<Box<dyn Phases>>,
        announce: impl FnOnce(&ExecutorHandle, ProcessSpec, Frame) -> (Announced, ProcessHandle),
    ) -> (Member, Announced) {
        let common = &self.common;
        if let Some(ledger) = &ledger {
            ledger.join(&common.emergency, &common.registry);
        }
        spec = spec.listed();
        if resident.is_none() && ledger.is_none() {
            spec = spec.unhurried();
        }
        if common.replay_logs.are_there() {
            spec = common.replay_logs.give_log(spec);
        }
        let frame = Frame::new(common);
        let (announced, handle) = announce(&self.executors[number], spec, frame);
        let member = Member::new(handle, On::Executor(number), ledger, resident);
        (member, announced)
    }

    /// Starts a prepared process: on a thread, which is held; on an executor once it is handed
    /// over.
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
            Placement::Executor(number) => {
                let announce = |executor: &_, spec, frame| starter.announce(executor, spec, frame);
                let (mut member, announced) =
                    self.announce(number, spec, ledger, resident, announce);
                member.shares_name = shares_name;
                return Ok((member, Started::OnExecutor(announced)));
            }
            Placement::Thread { name, attributes } => (name, attributes),
        };
        let common = &self.common;
        let frame = Frame::new(common);
        if let Some(ledger) = &ledger {
            ledger.join(&common.emergency, &common.registry);
        }
        let name = spec.name().clone();
        let attributes = (*attributes).mode(self.mode);
        let spec = common.replay_logs.give_log(spec.listed());
        let announce = |executor: &_| starter.announce(executor, spec, frame);
        let started = match &self.simulation {
            None => OsThread::start_counted(attributes, common.registry.clone(), announce),
            Some(simulation) => Ok(OsThread::start_simulated(simulation, &attributes, announce)),
        };
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
    pub(crate) reaped: bool,
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
    pub(in crate::system) fn new(
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
            reaped: false,
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

    /// The machine words of the process' own memory, some of which are addresses.
    pub(crate) fn words(&self) -> Vec<usize> {
        let mut words = self.handle.words_of_body();
        let seldom = self.seldom.as_ref();
        if let Some(resident) = seldom.and_then(|seldom| seldom.resident.as_ref()) {
            words.extend(resident.words());
        }
        words
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
