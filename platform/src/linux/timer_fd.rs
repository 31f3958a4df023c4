//! timerfd on `CLOCK_MONOTONIC`.

use crate::clock::{Instant, nanos};
use crate::path::{self, Call};
use crate::timer_fd::TimerError;
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::time::TimeSpec;
use nix::sys::timerfd::{ClockId, Expiration, TimerFd as SysTimer, TimerFlags, TimerSetTimeFlags};
use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;

/// A timer that is a file: disarmed, armed for one deadline, or periodic.
///
/// Linux only; elsewhere [`new`](Self::new) fails. Made off the real-time path; all else may be
/// done on it: one system call each, O(log of the system's timers). One thread reads it.
///
/// ```
/// use luna_platform::clock::Instant;
/// use luna_platform::timer_fd::{TimerError, TimerFd};
/// use std::time::Duration;
///
/// let timer = match TimerFd::new() {
///     Err(TimerError::Unsupported) => return Ok(()),
///     timer => timer?,
/// };
/// timer.arm_periodic(Instant::now(), Duration::from_millis(1))?;
/// let mut ticks = 0;
/// while ticks < 3 {
///     ticks += timer.wait()?; // more than one after a delay
/// }
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
    /// The process has no file descriptors left, or (elsewhere) [`TimerError::Unsupported`].
    pub fn new() -> Result<TimerFd, TimerError> {
        // Blocking, so that a thread can sleep on it in one call.
        let timer = SysTimer::new(ClockId::CLOCK_MONOTONIC, TimerFlags::TFD_CLOEXEC);
        timer
            .map(|timer| TimerFd { timer })
            .map_err(refused("timerfd_create"))
    }

    /// As [`new`](Self::new), but one that is not waited for here: a reactor watches it, and
    /// [`take`](Self::take) reads it.
    ///
    /// # Errors
    ///
    /// As for `new`.
    pub fn watched() -> Result<TimerFd, TimerError> {
        let flags = TimerFlags::TFD_CLOEXEC | TimerFlags::TFD_NONBLOCK;
        let timer = SysTimer::new(ClockId::CLOCK_MONOTONIC, flags);
        timer
            .map(|timer| TimerFd { timer })
            .map_err(refused("timerfd_create"))
    }

    /// How often a [`watched`](Self::watched) one expired since it was last read or armed: 0 if it
    /// did not, or was disarmed meanwhile. One system call, which does not wait.
    ///
    /// # Errors
    ///
    /// None that the caller could cause.
    pub fn take(&self) -> Result<u64, TimerError> {
        match self.read() {
            Err(Errno::EAGAIN) => Ok(0),
            taken => taken.map_err(refused("read")),
        }
    }

    /// Expires once, at `deadline`; at once if that has passed. [`Instant::NEVER`] disarms it. What
    /// expired before is forgotten.
    ///
    /// # Errors
    ///
    /// None that the caller could cause.
    pub fn arm_at(&self, deadline: Instant) -> Result<(), TimerError> {
        if deadline == Instant::NEVER {
            return self.disarm();
        }
        self.set(Expiration::OneShot(time_spec(deadline.as_nanos())))
    }

    /// Expires at `first` and then every `period` after that, on the same grid however late it is
    /// read. What expired before is forgotten. A `first` that has passed counts the expirations
    /// since then.
    ///
    /// # Errors
    ///
    /// [`TimerError::ZeroPeriod`].
    pub fn arm_periodic(&self, first: Instant, period: Duration) -> Result<(), TimerError> {
        if period.is_zero() {
            return Err(TimerError::ZeroPeriod);
        }
        self.set(Expiration::IntervalDelayed(
            time_spec(first.as_nanos()),
            time_spec(nanos(period)),
        ))
    }

    /// Expires no more. What expired before is forgotten.
    ///
    /// # Errors
    ///
    /// None that the caller could cause.
    pub fn disarm(&self) -> Result<(), TimerError> {
        path::expected(Call::ArmTimer, || self.timer.unset()).map_err(refused("timerfd_settime"))
    }

    /// Waits until it expires, and returns how often it did since it was last read or armed: at
    /// least 1.
    ///
    /// One system call. A timer that is not armed is waited for until another thread arms it.
    ///
    /// # Errors
    ///
    /// None that the caller could cause.
    pub fn wait(&self) -> Result<u64, TimerError> {
        self.read().map_err(refused("read"))
    }

    /// How often it expired since it was last read or armed: 0 if it did not. Does not wait; at
    /// most two system calls.
    ///
    /// # Errors
    ///
    /// None that the caller could cause.
    pub fn expirations(&self) -> Result<u64, TimerError> {
        let mut files = [PollFd::new(self.as_fd(), PollFlags::POLLIN)];
        match path::expected(Call::Sleep, || poll(&mut files, PollTimeout::ZERO)) {
            Ok(0) | Err(Errno::EINTR) => Ok(0),
            Ok(_) => self.wait(),
            Err(error) => Err(refused("poll")(error)),
        }
    }

    fn read(&self) -> Result<u64, Errno> {
        let mut count = [0; 8];
        loop {
            match path::expected(Call::Sleep, || nix::unistd::read(&self.timer, &mut count)) {
                // A signal's handler ran.
                Err(Errno::EINTR) => {}
                read => return read.map(|_| u64::from_ne_bytes(count)),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn once_and_not_before() {
        let timer = TimerFd::new().unwrap();
        let deadline = Instant::now() + Duration::from_millis(3);
        timer.arm_at(deadline).unwrap();
        assert_eq!(timer.wait(), Ok(1));
        assert!(Instant::now() >= deadline);
        assert_eq!(timer.expirations(), Ok(0));
    }

    #[test]
    fn deadlines_that_have_passed() {
        let timer = TimerFd::new().unwrap();
        timer.arm_at(Instant::from_nanos(0)).unwrap();
        assert_eq!(timer.wait(), Ok(1));
        // Ten and a half periods ago: eleven expirations at least.
        let first = Instant::now() - Duration::from_micros(10_500);
        timer.arm_periodic(first, Duration::from_millis(1)).unwrap();
        assert!(timer.wait().unwrap() >= 11);
    }

    #[test]
    fn a_periodic_one_keeps_its_grid() {
        let timer = TimerFd::new().unwrap();
        let (first, period) = (
            Instant::now() + Duration::from_millis(1),
            Duration::from_millis(1),
        );
        timer.arm_periodic(first, period).unwrap();
        let mut count = 0;
        while count < 20 {
            count += timer.wait().unwrap();
            assert!(Instant::now() >= first + period * (count as u32 - 1));
        }
    }

    #[test]
    fn a_watched_one_is_read_without_waiting() {
        let timer = TimerFd::watched().unwrap();
        assert_eq!(timer.take(), Ok(0));
        let first = Instant::now() - Duration::from_micros(2_500);
        timer.arm_periodic(first, Duration::from_secs(1)).unwrap();
        while timer.expirations() == Ok(0) {}
        assert_eq!(timer.take(), Ok(0), "it was read just before");
        timer.arm_at(Instant::from_nanos(1)).unwrap();
        timer.disarm().unwrap();
        assert_eq!(timer.take(), Ok(0));
    }

    #[test]
    fn disarmed_and_zero() {
        let timer = TimerFd::new().unwrap();
        assert_eq!(
            timer.arm_periodic(Instant::now(), Duration::ZERO),
            Err(TimerError::ZeroPeriod)
        );
        timer.arm_at(Instant::from_nanos(1)).unwrap();
        timer.arm_at(Instant::NEVER).unwrap();
        assert_eq!(
            timer.expirations(),
            Ok(0),
            "what expired before is forgotten"
        );
    }
}
