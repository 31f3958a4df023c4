//! Timers that are files: a thread can sleep on one that other threads arm, and a reactor can watch
//! one.
//!
//! They follow the clock of [`Instant`](crate::clock::Instant), and deadlines are absolute.

pub use crate::backend::timer_fd::TimerFd;

use std::fmt;

/// Why a timer operation failed.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum TimerError {
    /// The kernel refused.
    Kernel {
        /// The call that it refused.
        call: &'static str,
        /// Its words.
        message: String,
    },
    /// This backend has no such timers.
    Unsupported,
}

impl fmt::Display for TimerError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            TimerError::Kernel { call, message } => write!(f, "{call} failed: {message}; see {call}(2)"),
            TimerError::Unsupported => f.write_str(
                "timers that are files need Linux: the portable backend has none; run it on Linux, built without `--cfg luna_portable`",
            ),
        }
    }
}

impl std::error::Error for TimerError {}
