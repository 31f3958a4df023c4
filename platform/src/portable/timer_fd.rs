//! The standard library has no timers that are files.

use crate::clock::Instant;
use crate::timer_fd::TimerError;
use std::convert::Infallible;

/// A timer that is a file. This backend has none: [`new`](Self::new) always fails.
#[derive(Debug)]
pub struct TimerFd {
    never: Infallible,
}

impl TimerFd {
    /// Fails.
    ///
    /// # Errors
    ///
    /// Always [`TimerError::Unsupported`].
    pub fn new() -> Result<TimerFd, TimerError> {
        Err(TimerError::Unsupported)
    }

    /// There is no timer to arm.
    ///
    /// # Errors
    ///
    /// Cannot be called.
    pub fn arm_at(&self, _deadline: Instant) -> Result<(), TimerError> {
        match self.never {}
    }

    /// There is no timer to wait for.
    ///
    /// # Errors
    ///
    /// Cannot be called.
    pub fn wait(&self) -> Result<(), TimerError> {
        match self.never {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn says_that_there_are_none() {
        let error = TimerFd::new().unwrap_err();
        assert_eq!(error, TimerError::Unsupported);
        assert!(error.to_string().contains("Linux"), "{error}");
    }
}
