//! timerfd on `CLOCK_MONOTONIC`.

use crate::clock::Instant;
use crate::path::{self, Call};
use crate::timer_fd::TimerError;
use nix::errno::Errno;
use nix::sys::timerfd::{ClockId, Expiration, TimerFd as SysTimer, TimerFlags, TimerSetTimeFlags};
use std::os::fd::{AsFd, BorrowedFd};

/// A timer that is a file: disarmed, or armed for one deadline.
///
/// Made off the real-time path; all else may be done on it: one system call each, O(log of the
/// system's timers). One thread waits for it.
///
/// ```
/// use luna_platform::clock::Instant;
/// use luna_platform::timer_fd::{TimerError, TimerFd};
/// use std::time::Duration;
///
/// let timer = TimerFd::new()?;
/// let deadline = Instant::now() + Duration::from_millis(1);
/// timer.arm_at(deadline)?;
/// timer.wait()?;
/// assert!(Instant::now() >= deadline);
/// # Ok::<(), TimerError>(())
/// ```
#[derive(Debug)]
pub struct TimerFd {
    timer: SysTimer,
}

impl TimerFd {
    /// A timer that is not armed.
    ///
    /// # Errors
    ///
    /// The process has no file descriptors left.
    pub fn new() -> Result<TimerFd, TimerError> {
        // Blocking, so that a thread can sleep on it in one call.
        let timer = SysTimer::new(ClockId::CLOCK_MONOTONIC, TimerFlags::TFD_CLOEXEC);
        timer
            .map(|timer| TimerFd { timer })
            .map_err(refused("timerfd_create"))
    }

    /// Expires once, at `deadline`; at once if that has passed. [`Instant::NEVER`] disarms it. What
    /// expired before is forgotten.
    ///
    /// # Errors
    ///
    /// None that the caller could cause.
    pub fn arm_at(&self, deadline: Instant) -> Result<(), TimerError> {
        if deadline == Instant::NEVER {
            return path::expected(Call::ArmTimer, || self.timer.unset())
                .map_err(refused("timerfd_settime"));
        }
        // At least 1 ns, since 0 would disarm.
        let time = super::clock::timespec(deadline.as_nanos().max(1)).into();
        path::expected(Call::ArmTimer, || {
            let absolute = TimerSetTimeFlags::TFD_TIMER_ABSTIME;
            self.timer.set(Expiration::OneShot(time), absolute)
        })
        .map_err(refused("timerfd_settime"))
    }

    /// Waits until it expires, if it has not since it was last waited for or armed.
    ///
    /// One system call. A timer that is not armed is waited for until another thread arms it.
    ///
    /// # Errors
    ///
    /// None that the caller could cause.
    pub fn wait(&self) -> Result<(), TimerError> {
        let mut count = [0; 8];
        loop {
            match path::expected(Call::Sleep, || nix::unistd::read(&self.timer, &mut count)) {
                // A signal's handler ran.
                Err(Errno::EINTR) => {}
                read => return read.map(drop).map_err(refused("read")),
            }
        }
    }
}

impl AsFd for TimerFd {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.timer.as_fd()
    }
}

fn refused(call: &'static str) -> impl Fn(Errno) -> TimerError {
    move |error| TimerError::Kernel {
        call,
        message: error.to_string(),
    }
}
