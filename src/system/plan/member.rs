//! A started process, as its system sees it.

use crate::csp::composition::ThreadPart;
use crate::csp::process::Phases;
use crate::safety::Ledger;
use luna_executors::ProcessHandle;
use std::sync::Arc;

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
