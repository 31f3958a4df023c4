//! How a process is started where the system runs.

use super::described::{Placement, ProcessPlan};
use super::member::{Member, On};
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
        let Common {
            emergency,
            registry,
            ..
        } = &*self.common;
        emergency.is_safe()
            || !emergency.has_begun() && (registry.count() == 0 || self.standstill().is_some())
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
                let announce =
                    |executor: &_, spec, frame| starter.on_executor(executor, spec, frame);
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
        let started = starter.on_thread(
            (*attributes).mode(self.mode),
            common.replay_logs.give_log(spec.listed()),
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
