//! timerfd on `CLOCK_MONOTONIC`.

use crate::clock::Instant;
use crate::path::{self, Call};
use crate::timer_fd::TimerError;
use nix::errno::Errno;
use nix::sys::time::TimeSpec;
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
        self.set(Expiration::OneShot(time_spec(deadline.as_nanos())))
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

    fn set(&self, expiration: Expiration) -> Result<(), TimerError> {
        path::expected(Call::ArmTimer, || {
            self.timer
                .set(expiration, TimerSetTimeFlags::TFD_TIMER_ABSTIME)
        })
        .map_err(refused("timerfd_settime"))
    }
}

impl AsFd for TimerFd {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.timer.as_fd()
    }
}

/// A time as the kernel takes it, at least 1 ns, since 0 would disarm.
fn time_spec(nanos: u64) -> TimeSpec {
    super::clock::timespec(nanos.max(1)).into()
}

fn refused(call: &'static str) -> impl Fn(Errno) -> TimerError {
    move |error| TimerError::Kernel {
        call,
        message: error.to_string(),
    }
}
