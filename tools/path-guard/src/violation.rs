//! Violations of the path's rules.

use std::fmt;

/// A forbidden operation on the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Kind {
    /// Memory was allocated.
    Allocation {
        /// How much.
        bytes: usize,
    },
    /// Memory grew or shrank.
    Reallocation {
        /// How much it was.
        from: usize,
        /// How much it was to be.
        to: usize,
    },
    /// Memory was freed.
    Free {
        /// How much.
        bytes: usize,
    },
    /// The thread waited in a futex other than the framework's sleep: for a lock, a condition or
    /// another thread.
    Lock {
        /// The operation, as futex(2) calls it.
        operation: &'static str,
    },
    /// Another system call was made.
    SystemCall {
        /// Its number on this machine.
        number: i64,
        /// Its name; empty if unknown here.
        name: &'static str,
    },
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Kind::Allocation { bytes } => write!(f, "allocation of {bytes} bytes"),
            Kind::Reallocation { from, to } => {
                write!(f, "reallocation of {from} bytes as {to}")
            }
            Kind::Free { bytes } => write!(f, "free of {bytes} bytes"),
            Kind::Lock { operation } => write!(
                f,
                "blocking lock, or another wait, by the system call futex ({operation})"
            ),
            Kind::SystemCall { number, name: "" } => write!(f, "system call {number}"),
            Kind::SystemCall { number, name } => write!(f, "system call {name} ({number})"),
        }
    }
}

/// One breach of the path's rules: the operation, its process, its thread, and its place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Violation {
    pub(crate) kind: Kind,
    pub(crate) process: Option<String>,
    pub(crate) thread: String,
    pub(crate) times: u64,
    pub(crate) backtrace: String,
}

impl Violation {
    /// What was done.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// The process that did it; `None` for its executor, between two polls.
    pub fn process(&self) -> Option<&str> {
        self.process.as_deref()
    }

    /// The thread on which it was done: an executor's has its name.
    pub fn thread(&self) -> &str {
        &self.thread
    }

    /// How often it was done in the very same place.
    pub fn times(&self) -> u64 {
        self.times
    }

    /// The way there, the innermost function first, a line or two for each.
    pub fn backtrace(&self) -> &str {
        &self.backtrace
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.process {
            Some(process) => write!(f, "process `{process}` on `{}`", self.thread)?,
            None => write!(f, "thread `{}`, between two polls", self.thread)?,
        }
        write!(f, ": {}", self.kind)?;
        if self.times > 1 {
            write!(f, ", {} times", self.times)?;
        }
        write!(f, "\n{}", self.backtrace)
    }
}
