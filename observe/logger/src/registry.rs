//! The signals of a system: their names, and how many of their samples were lost.

use crate::format::{MAX_SIGNALS, Type};
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

/// The most bytes of a signal's name, unit and description.
const MAX_NAME: usize = 255;
const MAX_UNIT: usize = 63;
const MAX_DESCRIPTION: usize = 1023;

/// What a signal is, for the recorder.
#[derive(Debug, Clone)]
pub(crate) struct Declared {
    pub(crate) name: Arc<str>,
    pub(crate) unit: Arc<str>,
    pub(crate) description: Arc<str>,
    pub(crate) element_type: Type,
    pub(crate) elements: u8,
    pub(crate) losses: Arc<Losses>,
}

impl Declared {
    /// Whether its texts can be recorded.
    pub(crate) fn check(&self) -> Result<(), RegisterError> {
        for (what, text, most) in [
            ("name", &self.name, MAX_NAME),
            ("unit", &self.unit, MAX_UNIT),
            ("description", &self.description, MAX_DESCRIPTION),
        ] {
            if text.len() > most {
                return Err(RegisterError::TooLong {
                    signal: self.name.to_string(),
                    what,
                    most,
                });
            }
        }
        if self.name.is_empty() {
            return Err(RegisterError::NoName);
        }
        Ok(())
    }
}

/// How many samples of a signal were dropped before they reached the recorder, and how many handles
/// use it.
#[derive(Debug, Default)]
pub(crate) struct Losses {
    lost: AtomicU64,
    users: AtomicU32,
}

impl Losses {
    #[cold]
    #[inline(never)]
    pub(crate) fn count(&self) {
        self.lost.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn get(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }

    pub(crate) fn join(&self) {
        self.users.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn leave(&self) {
        self.users.fetch_sub(1, Ordering::Relaxed);
    }

    fn is_used(&self) -> bool {
        self.users.load(Ordering::Relaxed) > 0
    }
}

/// All signals of a system, in the order of their numbers.
#[derive(Default)]
pub(crate) struct Signals {
    all: Vec<Declared>,
    numbers: HashMap<Arc<str>, u32>,
}

impl Signals {
    /// Those from this number on.
    pub(crate) fn since(&self, number: usize) -> &[Declared] {
        &self.all[number..]
    }

    /// Assigns a number to a signal.
    pub(crate) fn declare(
        &mut self,
        declared: Declared,
    ) -> Result<(u32, Arc<Losses>), RegisterError> {
        declared.check()?;
        let name = || declared.name.to_string();
        if let Some(&number) = self.numbers.get(&declared.name) {
            let there = &self.all[number as usize];
            let is_same = there.element_type == declared.element_type
                && there.elements == declared.elements
                && there.unit == declared.unit;
            // All handles are gone: a process that is started again continues its signal.
            if there.losses.is_used() || !is_same {
                return Err(RegisterError::Duplicate { signal: name() });
            }
            there.losses.join();
            return Ok((number, there.losses.clone()));
        }
        let number = self.all.len();
        if number >= MAX_SIGNALS {
            return Err(RegisterError::TooMany { signal: name() });
        }
        let losses = declared.losses.clone();
        losses.join();
        self.numbers.insert(declared.name.clone(), number as u32);
        self.all.push(declared);
        Ok((number as u32, losses))
    }
}

/// Why a signal cannot be registered.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RegisterError {
    /// It was not registered in `pre_run` of a process.
    #[error(
        "signal `{signal}` was registered outside of `pre_run`; declare it where its process is spawned (`process.signal({signal:?})`), or register it in `pre_run` of the process (`impl luna::Process`)"
    )]
    NotInPreRun {
        /// The signal's name.
        signal: String,
    },
    /// Another signal has the name.
    #[error(
        "the name `{signal}` is taken: another signal of the system has it, or had it with another type or unit; name signals with what they are of, such as \"pump/flow\""
    )]
    Duplicate {
        /// The name.
        signal: String,
    },
    /// Its name is empty.
    #[error("a signal has an empty name; give it one")]
    NoName,
    /// One of its texts is too long.
    #[error("the {what} of signal `{signal}` has more than {most} bytes; use a shorter one")]
    TooLong {
        /// The signal's name.
        signal: String,
        /// Which of its texts.
        what: &'static str,
        /// How many bytes it may have.
        most: usize,
    },
    /// There are as many signals as a recording may have.
    #[error(
        "signal `{signal}` is one more than the {MAX_SIGNALS} that a recording may have; record arrays"
    )]
    TooMany {
        /// The signal's name.
        signal: String,
    },
}
