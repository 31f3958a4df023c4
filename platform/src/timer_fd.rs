//! Timers that a thread can sleep on and other threads arm. On Linux they are files, which a reactor
//! can watch.
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Instant;
    use std::time::Duration;

    #[test]
    fn once_and_not_before() {
        let timer = TimerFd::new().unwrap();
        let deadline = Instant::now() + Duration::from_millis(3);
        timer.arm_at(deadline).unwrap();
        timer.wait().unwrap();
        assert!(Instant::now() >= deadline);
    }

    #[test]
    fn what_was_armed_last_counts() {
        let timer = TimerFd::new().unwrap();
        timer.arm_at(Instant::from_nanos(1)).unwrap();
        timer.arm_at(Instant::NEVER).unwrap();
        let deadline = Instant::now() + Duration::from_millis(3);
        timer.arm_at(deadline).unwrap();
        timer.wait().unwrap();
        assert!(
            Instant::now() >= deadline,
            "what expired before is forgotten"
        );
        // One that has passed.
        timer.arm_at(Instant::from_nanos(0)).unwrap();
        timer.wait().unwrap();
    }
}
