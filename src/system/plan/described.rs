//! What is to be: executors and processes, as they were described.

use crate::csp::process::Prepared;
use crate::safety::Ledger;
use luna_core::ProcessSpec;
use luna_core::current::ProcessId;
use luna_platform::thread::Attributes;
use std::sync::Arc;

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
pub(super) struct Names {
    /// Its own, unless it shares one.
    pub(super) process: Option<String>,
    /// That of its thread.
    pub(super) thread: Option<String>,
}

impl ProcessPlan {
    pub(super) fn names(&self) -> Names {
        Names {
            process: (!self.shares_name).then(|| self.name().to_owned()),
            thread: self.thread_name().map(str::to_owned),
        }
    }

    /// The name of its own thread, if it has one.
    #[inline]
    pub(super) fn thread_name(&self) -> Option<&str> {
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
