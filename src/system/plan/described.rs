//! What is to be: executors and processes, as they were described.

use crate::csp::process::{Build, Prepared, Start};
use crate::safety::Ledger;
use luna_core::current::ProcessId;
use luna_core::{Name, ProcessSpec};
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

/// A described process; `B` makes its body.
pub(crate) struct ProcessPlan<B = Box<dyn Start>> {
    pub(crate) place: Placement,
    pub(crate) spec: ProcessSpec,
    /// Others may have its name too.
    pub(crate) shares_name: bool,
    pub(crate) ledger: Option<Arc<Ledger>>,
    pub(crate) prepared: Prepared<B>,
}

/// The names that a process takes: they are given back if it is refused.
pub(super) struct Names {
    /// Its own, unless it shares one.
    pub(super) process: Option<Name>,
    /// That of its thread.
    pub(super) thread: Option<String>,
}

impl<B> ProcessPlan<B> {
    pub(super) fn names(&self) -> Names {
        Names {
            process: (!self.shares_name).then(|| self.name().clone()),
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

    pub(crate) fn name(&self) -> &Name {
        self.spec.name()
    }

    pub(crate) fn id(&self) -> ProcessId {
        self.spec.id()
    }

    /// The same description with another body.
    #[inline]
    pub(crate) fn map<C>(self, other: impl FnOnce(Prepared<B>) -> Prepared<C>) -> ProcessPlan<C> {
        ProcessPlan {
            place: self.place,
            spec: self.spec,
            shares_name: self.shares_name,
            ledger: self.ledger,
            prepared: other(self.prepared),
        }
    }
}

impl<B: Build> ProcessPlan<B> {
    /// The same description with a boxed body, for lists of mixed types.
    pub(super) fn boxed(self) -> ProcessPlan {
        self.map(Prepared::boxed)
    }
}
