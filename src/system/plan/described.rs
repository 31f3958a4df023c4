//! What is to be: executors and processes, as they were described.

use crate::csp::process::{Build, Prepared, Start};
use crate::safety::Ledger;
use luna_core::current::ProcessId;
use luna_executors::{Name, ProcessSpec};
use luna_platform::thread::Attributes;
use std::sync::Arc;

/// Where a process is to run.
pub(crate) enum Placement {
    /// The executor with this number.
    Executor(usize),
    /// A thread of its own.
    Thread(Box<Attributes>),
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

impl<B> ProcessPlan<B> {
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
