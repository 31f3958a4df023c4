//! What the manager's thread sleeps on: one timer of the kernel.

use crate::error::SetupError;
use luna_core::timer_queue::DeadlineListener;
use luna_platform::clock::Instant;
use luna_platform::timer_fd::TimerFd;

/// The timer, which any thread arms and one waits for.
pub(super) struct Alarm(TimerFd);

impl Alarm {
    /// A timer that is not armed. Allocates, and takes a file.
    pub(super) fn new() -> Result<Self, SetupError> {
        let refused =
            |error| SetupError::system(format!("the timer manager has no timer: {error}"));
        TimerFd::new().map(Self).map_err(refused)
    }

    /// Sleeps until the timer expires. May end without a cause.
    pub(super) fn wait(&self) {
        let expired = self.0.wait();
        debug_assert!(expired.is_ok(), "{expired:?}");
    }
}

impl DeadlineListener for Alarm {
    fn ask_look(&self) {
        self.ask_look_at(Instant::from_nanos(0));
    }

    fn ask_look_at(&self, deadline: Instant) {
        let armed = self.0.arm_at(deadline);
        debug_assert!(armed.is_ok(), "{armed:?}");
    }
}
