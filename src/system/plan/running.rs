//! How a process is started where the system runs.

use super::described::{Placement, ProcessPlan};
use crate::csp::composition::{ThreadKind, ThreadPart};
use crate::csp::process::{Common, Frame, Phases};
use crate::error::Error;
use crate::safety::Ledger;
use luna_core::current::ProcessId;
use luna_core::{
    Announced, ExecutorHandle, Exit, Name, OsThread, ProcessHandle, ProcessSpec, ProcessState,
    SimulationHandle, Standstill,
};
use luna_machine::memory::copy_words;
use luna_platform::thread::Mode;
use std::sync::Arc;
use std::time::Duration;

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

    /// Announces a prepared process on an executor by `announce`. No user code runs there.
    #[inline]
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
        let executor = &self.executors[number];
        let frame = (!executor.is_here()).then(|| common.clone());
        let (announced, handle) = announce(executor, spec, frame);
        let member = Member::new(handle, On::Executor(number), ledger, resident);
        (member, announced)
    }

    /// Starts a prepared process: on a thread, which is held; on an executor once it is handed
    /// over.
    pub(crate) fn start(&self, plan: ProcessPlan) -> Result<(Member, Started), NotStarted> {
        let (spec, ledger, shares_name) = (plan.spec, plan.ledger, plan.shares_name);
        let (resident, starter) = (plan.prepared.resident, plan.prepared.build);
        let attributes = match plan.place {
            Placement::Executor(number) => {
                let announce = |executor: &_, spec, frame| starter.announce(executor, spec, frame);
                let (mut member, announced) =
                    self.announce(number, spec, ledger, resident, announce);
                member.shares_name = shares_name;
                return Ok((member, Started::OnExecutor(announced)));
            }
            Placement::Thread(attributes) => attributes,
        };
        let common = &self.common;
        let frame = Some(common.clone());
        if let Some(ledger) = &ledger {
            ledger.join(&common.emergency, &common.registry);
        }
        let name = spec.name().clone();
        let thread_name = attributes.name().to_owned();
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
    is: Is,
    /// Its place in the order of starts.
    pub(crate) order: u32,
    /// The number of its executor, or [`NO_EXECUTOR`].
    executor: u16,
    pub(crate) shares_name: bool,
    pub(crate) has_failed: bool,
}

#[cfg(target_pointer_width = "64")]
const _: () = assert!(size_of::<Option<Member>>() == 32);

/// What there is of a process.
enum Is {
    Kept {
        handle: ProcessHandle,
        seldom: Option<Box<Seldom>>,
        /// It was spawned while the system ran.
        is_late: bool,
        /// Its end was noted.
        is_reaped: bool,
    },
    /// It has completed, and its memory is let go of.
    Ended {
        name: Name,
        polls: u32,
        priority: u8,
    },
}

/// What others see of a process.
pub(crate) struct Known {
    pub(crate) state: ProcessState,
    pub(crate) priority: u8,
    pub(crate) exit: Option<Exit>,
    pub(crate) polls: u64,
    pub(crate) longest_poll: Option<Duration>,
}

/// In the place of the number of an executor: it has a thread of its own.
const NO_EXECUTOR: u16 = u16::MAX;

/// What few members have.
struct Seldom {
    ledger: Option<Arc<Ledger>>,
    resident: Option<Box<dyn Phases>>,
    thread: Option<Box<ThreadPart>>,
}

impl Member {
    #[inline]
    pub(in crate::system) fn new(
        handle: ProcessHandle,
        on: On,
        ledger: Option<Arc<Ledger>>,
        resident: Option<Box<dyn Phases>>,
    ) -> Self {
        let (executor, thread) = match on {
            On::Executor(number) => (u16::try_from(number).unwrap_or(NO_EXECUTOR), None),
            On::Thread(part) => (NO_EXECUTOR, Some(part)),
        };
        let has_any = ledger.is_some() || resident.is_some() || thread.is_some();
        let seldom = has_any.then(|| {
            Box::new(Seldom {
                ledger,
                resident,
                thread,
            })
        });
        Self {
            is: Is::Kept {
                handle,
                seldom,
                is_late: false,
                is_reaped: false,
            },
            order: 0,
            executor,
            shares_name: false,
            has_failed: false,
        }
    }

    /// Notes that it was spawned while the system ran.
    pub(in crate::system) fn set_late(&mut self) {
        if let Is::Kept { is_late, .. } = &mut self.is {
            *is_late = true;
        }
    }

    /// Whether it need not be remembered when it has ended.
    pub(in crate::system) fn may_be_forgotten(&self) -> bool {
        let is_on_executor = self.executor != NO_EXECUTOR;
        is_on_executor && matches!(self.is, Is::Kept { is_late: true, .. })
    }

    pub(crate) fn is_reaped(&self) -> bool {
        matches!(
            self.is,
            Is::Kept {
                is_reaped: true,
                ..
            } | Is::Ended { .. }
        )
    }

    /// Notes its end. Gives whether it was noted before.
    pub(in crate::system) fn reap(&mut self) -> bool {
        match &mut self.is {
            Is::Kept { is_reaped, .. } => std::mem::replace(is_reaped, true),
            Is::Ended { .. } => true,
        }
    }

    /// Lets go of the memory of a process that has just completed, if it has nothing that few
    /// have. Gives its handle.
    #[inline]
    pub(in crate::system) fn forget_completed(&mut self) -> Option<ProcessHandle> {
        let Is::Kept {
            handle,
            seldom: None,
            ..
        } = &self.is
        else {
            return None;
        };
        let (name, polls) = handle.completed()?;
        let ended = Is::Ended {
            name,
            polls: u32::try_from(polls).ok()?,
            priority: handle.priority(),
        };
        match std::mem::replace(&mut self.is, ended) {
            Is::Kept { handle, .. } => Some(handle),
            Is::Ended { .. } => None,
        }
    }

    /// Lets go of the room of the body of a process that has ended in any way.
    pub(in crate::system) fn forget_body(&mut self) -> Option<ProcessHandle> {
        if let Is::Kept { seldom, .. } = &mut self.is {
            seldom.take_if(|one| {
                one.ledger.is_none() && one.resident.is_none() && one.thread.is_none()
            });
        }
        let completed = self.forget_completed();
        if let Is::Kept { handle, .. } = &mut self.is {
            handle.forget_body();
        }
        completed
    }

    /// Its handle, if it is kept.
    pub(crate) fn kept(&self) -> Option<&ProcessHandle> {
        match &self.is {
            Is::Kept { handle, .. } => Some(handle),
            Is::Ended { .. } => None,
        }
    }

    /// Its handle, as it was, or made anew. May allocate.
    pub(crate) fn handle(&self, id: ProcessId) -> ProcessHandle {
        match &self.is {
            Is::Kept { handle, .. } => handle.clone(),
            &Is::Ended {
                ref name,
                polls,
                priority,
            } => ProcessHandle::of_completed(id, name.clone(), priority, polls.into()),
        }
    }

    pub(crate) fn name(&self) -> &Name {
        match &self.is {
            Is::Kept { handle, .. } => handle.as_name(),
            Is::Ended { name, .. } => name,
        }
    }

    #[inline]
    pub(crate) fn known(&self) -> Known {
        match &self.is {
            Is::Kept { handle, .. } => Known {
                state: handle.state(),
                priority: handle.priority(),
                exit: handle.exit(),
                polls: handle.polls(),
                longest_poll: handle.longest_poll(),
            },
            &Is::Ended {
                polls, priority, ..
            } => Known {
                state: ProcessState::Ended,
                priority,
                exit: Some(Exit::Completed),
                polls: polls.into(),
                longest_poll: None,
            },
        }
    }

    fn seldom(&self) -> Option<&Seldom> {
        match &self.is {
            Is::Kept { seldom, .. } => seldom.as_deref(),
            Is::Ended { .. } => None,
        }
    }

    pub(crate) fn ledger(&self) -> Option<&Arc<Ledger>> {
        self.seldom()?.ledger.as_ref()
    }

    pub(crate) fn take_resident(&mut self) -> Option<Box<dyn Phases>> {
        match &mut self.is {
            Is::Kept { seldom, .. } => seldom.as_mut()?.resident.take(),
            Is::Ended { .. } => None,
        }
    }

    /// The machine words of the process' own memory, some of which are addresses: a hint for reports.
    /// What it holds behind a box is not among them, and what it has given away may still be.
    pub(crate) fn words(&self) -> Vec<usize> {
        let body = self.kept().and_then(ProcessHandle::addresses_of_body);
        let mut words = body.map(copy_words).unwrap_or_default();
        if let Some(resident) = self.seldom().and_then(|seldom| seldom.resident.as_ref()) {
            words.extend(resident.words());
        }
        words
    }

    /// Where it was started.
    pub(crate) fn on(&self) -> On {
        match self.seldom().and_then(|seldom| seldom.thread.as_ref()) {
            Some(part) => On::Thread(part.clone()),
            None => On::Executor(self.executor.into()),
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
