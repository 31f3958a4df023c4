//! What the manager's thread sleeps on: one timer of the kernel.

use crate::error::SetupError;
use luna_core::park::Parker;
use luna_core::timer_queue::DeadlineListener;
use luna_platform::clock::Instant;
use luna_platform::timer_fd::{TimerError, TimerFd};
use std::sync::atomic::{AtomicU64, Ordering};

/// The timer, which any thread arms and one waits for.
pub(super) enum Alarm {
    /// The kernel's.
    File(TimerFd),
    /// Where the kernel has no timers that are files: the thread's own sleep, until `next`.
    Sleep { parker: Parker, next: AtomicU64 },
}

impl Alarm {
    /// A timer that is not armed. Allocates, and takes a file.
    pub(super) fn new() -> Result<Self, SetupError> {
        match TimerFd::new() {
            Ok(timer) => Ok(Alarm::File(timer)),
            Err(TimerError::Unsupported) => Ok(Self::without_file()),
            Err(error) => Err(SetupError::system(format!(
                "the timer manager has no timer: {error}"
            ))),
        }
    }

    fn without_file() -> Self {
        Alarm::Sleep {
            parker: Parker::new(),
            next: AtomicU64::new(Instant::NEVER.as_nanos()),
        }
    }

    /// Sleeps until the timer expires. May end without a cause.
    pub(super) fn wait(&self) {
        match self {
            Alarm::File(timer) => {
                let expired = timer.wait();
                debug_assert!(expired.is_ok(), "{expired:?}");
            }
            Alarm::Sleep { parker, next } => {
                parker.park(Instant::from_nanos(next.load(Ordering::Acquire)));
            }
        }
    }
}

impl DeadlineListener for Alarm {
    fn ask_look(&self) {
        self.ask_look_at(Instant::from_nanos(0));
    }

    fn ask_look_at(&self, deadline: Instant) {
        match self {
            Alarm::File(timer) => {
                let armed = timer.arm_at(deadline);
                debug_assert!(armed.is_ok(), "{armed:?}");
            }
            Alarm::Sleep { parker, next } => {
                next.store(deadline.as_nanos(), Ordering::Release);
                // It may come before what the thread sleeps for.
                parker.unpark();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn both_kinds_sleep_until_the_instant_that_was_set_last() {
        for alarm in [Alarm::new().unwrap(), Alarm::without_file()] {
            let deadline = Instant::now() + Duration::from_millis(2);
            alarm.ask_look_at(deadline + Duration::from_secs(1000));
            alarm.ask_look_at(deadline);
            while Instant::now() < deadline {
                alarm.wait();
            }
            alarm.ask_look();
            alarm.wait();
        }
    }
}
