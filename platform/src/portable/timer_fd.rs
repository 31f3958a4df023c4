//! Timers of the standard library, in the place of those that are files.

use crate::clock::Instant;
use crate::timer_fd::TimerError;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// A timer: disarmed, or armed for one deadline. One thread waits for it.
#[derive(Debug)]
pub struct TimerFd {
    /// [`Instant::NEVER`] while it is not armed.
    deadline: Mutex<Instant>,
    changed: Condvar,
}

impl TimerFd {
    /// A timer that is not armed.
    ///
    /// # Errors
    ///
    /// None.
    pub fn new() -> Result<TimerFd, TimerError> {
        Ok(TimerFd {
            deadline: Mutex::new(Instant::NEVER),
            changed: Condvar::new(),
        })
    }

    fn deadline(&self) -> MutexGuard<'_, Instant> {
        self.deadline.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Expires once, at `deadline`; at once if that has passed. [`Instant::NEVER`] disarms it. What
    /// expired before is forgotten.
    ///
    /// # Errors
    ///
    /// None.
    pub fn arm_at(&self, deadline: Instant) -> Result<(), TimerError> {
        *self.deadline() = deadline;
        self.changed.notify_one();
        Ok(())
    }

    /// Waits until it expires, if it has not since it was last waited for or armed.
    ///
    /// # Errors
    ///
    /// None.
    pub fn wait(&self) -> Result<(), TimerError> {
        let mut deadline = self.deadline();
        loop {
            let now = Instant::now_real();
            if *deadline <= now {
                *deadline = Instant::NEVER;
                return Ok(());
            }
            let left = *deadline - now;
            let waited = self.changed.wait_timeout(deadline, left);
            deadline = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}
