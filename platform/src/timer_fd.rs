//! Timers that are files: a thread can sleep on one that other threads arm, and a reactor can watch
//! one.
//!
//! They follow the clock of [`Instant`](crate::clock::Instant), and deadlines are absolute.

pub use crate::backend::timer_fd::TimerFd;

/// Why a timer operation failed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TimerError {
    /// The kernel refused.
    #[error("{call} failed: {message}; see {call}(2)")]
    Kernel {
        /// The call that it refused.
        call: &'static str,
        /// Its words.
        message: String,
    },
    /// This backend has no such timers.
    #[error(
        "timers that are files need Linux: the portable backend has none; run it on Linux, built \
         without `--cfg luna_portable`"
    )]
    Unsupported,
}
