//! Stand-ins: other bodies for processes that are declared with their channel ends, chosen by name.

use crate::csp::process::{IntoProcess, Prepared};
use crate::error::SetupError;
use std::any::{Any, TypeId, type_name};
use std::collections::BTreeMap;

/// The stand-ins of a system, and the processes that can be replaced.
#[derive(Default)]
pub(crate) struct StandIns {
    waiting: BTreeMap<String, StandIn>,
    /// Processes that were declared with their ends, and whether one stood in.
    declared: BTreeMap<String, bool>,
    /// The system has started.
    is_closed: bool,
}

/// A body for a process with ends of a type known at run time alone.
pub(super) struct StandIn {
    ends: TypeId,
    type_name: &'static str,
    /// Makes the process of the ends that were [declared](StandIns::declare). Calls what is the
    /// user's.
    pub(super) prepare: Box<Prepare>,
}

type Prepare = dyn FnOnce(Box<dyn Any>) -> Prepared + Send;

impl StandIns {
    pub(super) fn add<E: Send + 'static, M, P: IntoProcess<M>>(
        &mut self,
        process: &str,
        body: impl FnOnce(E) -> P + Send + 'static,
    ) -> Result<(), SetupError> {
        if self.is_closed || self.declared.contains_key(process) {
            return Err(SetupError::StandInTooLate {
                process: process.to_owned(),
            });
        }
        if self.waiting.contains_key(process) {
            return Err(SetupError::DuplicateName {
                kind: "stand-in",
                name: process.to_owned(),
            });
        }
        let stand_in = StandIn {
            ends: TypeId::of::<E>(),
            type_name: type_name::<E>(),
            prepare: Box::new(|ends| {
                let Ok(ends) = ends.downcast() else {
                    unreachable!("its type was compared")
                };
                body(*ends).prepare()
            }),
        };
        self.waiting.insert(process.to_owned(), stand_in);
        Ok(())
    }

    /// Declares a process with ends of type `E`; returns its stand-in, if it has one.
    pub(super) fn declare<E: 'static>(
        &mut self,
        process: &str,
    ) -> Result<Option<StandIn>, SetupError> {
        let stand_in = match self.waiting.get(process) {
            Some(stand_in) if stand_in.ends != TypeId::of::<E>() => {
                return Err(SetupError::StandInDoesNotFit {
                    process: process.to_owned(),
                    has: type_name::<E>(),
                    takes: stand_in.type_name,
                });
            }
            _ => self.waiting.remove(process),
        };
        // Those that come and go while the system runs are not kept.
        if !self.is_closed {
            self.declared.insert(process.to_owned(), stand_in.is_some());
        }
        Ok(stand_in)
    }

    /// A process that is spawned without its ends cannot be replaced.
    pub(super) fn check_plain(&self, process: &str) -> Result<(), SetupError> {
        if self.waiting.contains_key(process) {
            return Err(SetupError::NotReplaceable {
                process: process.to_owned(),
            });
        }
        Ok(())
    }

    /// When the system starts: none may be left.
    pub(super) fn close(&mut self) -> Result<(), SetupError> {
        match self.waiting.keys().next() {
            None => {
                self.is_closed = true;
                Ok(())
            }
            Some(process) => Err(SetupError::NobodyToReplace {
                process: process.clone(),
                known: self.declared.keys().cloned().collect(),
            }),
        }
    }

    /// The processes that others stand in for.
    pub(super) fn replaced(&self) -> Vec<String> {
        let replaced = self
            .declared
            .iter()
            .filter(|(_, is_replaced)| **is_replaced);
        replaced.map(|(name, _)| name.clone()).collect()
    }
}
