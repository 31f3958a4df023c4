//! Attributes that the system refused a thread, in its own words: `luna-machine` finds out why.

use super::Policy;
use std::fmt;
use std::time::Duration;

/// Something that was asked for a thread and not given.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Refusal {
    /// A real-time policy; the thread runs under [`Policy::Other`].
    Policy {
        /// The policy asked for.
        asked: Policy,
        /// Why it was refused.
        why: Why,
    },
    /// A core; the thread is not pinned.
    Core {
        /// The core asked for.
        asked: usize,
        /// Why it was refused.
        why: Why,
    },
    /// To look for work before each sleep; the thread sleeps at once.
    Spin {
        /// The time asked for.
        asked: Duration,
        /// Why it was refused.
        why: SpinRefusal,
    },
}

/// What the system said.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Why {
    /// The kernel's error number.
    Kernel(i32),
    /// Nothing was refused, yet the thread has not got it, but this policy.
    NotKept(Policy),
    /// This backend has no such attribute.
    Unsupported,
}

/// Why a thread sleeps at once: spinning could keep another thread from running that has work for
/// it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SpinRefusal {
    /// The thread is not pinned to a core.
    #[error("the thread has no core of its own")]
    NotPinned,
    /// Another thread of the system is pinned to the same core.
    #[error("it shares its core with `{with}`")]
    SharedCore {
        /// That one's name.
        with: String,
    },
    /// Another thread of the system is not pinned, so it may run on the same core.
    #[error("`{name}` is not pinned, so it may run on the same core")]
    UnpinnedNeighbour {
        /// That one's name.
        name: String,
    },
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Policy { asked, why } => write!(f, "no policy {asked}: {why}"),
            Self::Core { asked, why } => write!(f, "no core {asked}: {why}"),
            Self::Spin { asked, why } => {
                write!(f, "no {asked:?} of looking for work before a sleep: {why}")
            }
        }
    }
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Kernel(number) => std::io::Error::from_raw_os_error(*number).fmt(f),
            Self::NotKept(policy) => write!(f, "it was set, but the thread runs under {policy}"),
            Self::Unsupported => f.write_str("the portable backend has none"),
        }
    }
}

impl std::error::Error for Refusal {}
