//! Set-points that stop coming.

use crate::block::{Sample, Verdict};
use crate::fault::Fault;
use crate::setting::{Of, SettingError};
use std::time::Duration;

/// Detects that no set-point has come for too long, and replaces it by a fall-back.
///
/// Guards against a controller that hangs, has ended, or is late, and against a broken link. Bound:
/// `time` from the last set-point, or from the beginning. As a process
/// ([`ChainProcess::timeout`](crate::ChainProcess::timeout)) it wakes up by itself at that instant.
/// Does not detect a controller that repeats the same set-point: see [`Frozen`](crate::Frozen).
///
/// ```
/// use luna_safety_blocks::{Timeout, Verdict};
/// use std::time::Duration;
///
/// let ms = Duration::from_millis(1);
/// let mut speed = Timeout::new(20 * ms, 0.0)?;
/// assert_eq!(speed.step(Some(0.3), ms), Verdict::Pass(0.3));
/// assert_eq!(speed.step(None, 19 * ms), Verdict::Pass(0.3)); // not yet
/// assert!(matches!(speed.step(None, ms), Verdict::Refused(_)));
/// # Ok::<(), luna_safety_blocks::SettingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Timeout {
    time: Duration,
    repeat: Duration,
    fallback: f64,
    last: f64,
    silent: Duration,
}

impl Timeout {
    /// At least one set-point in each `time`; otherwise `fallback`, in the unit of the signal.
    ///
    /// # Errors
    ///
    /// `time` is zero, or `fallback` is not finite.
    pub fn new(time: Duration, fallback: f64) -> Result<Self, SettingError> {
        let of = Of("timeout");
        Ok(Self {
            time: of.time("time", time)?,
            repeat: time,
            fallback: of.finite("fall-back", fallback)?,
            last: fallback,
            silent: Duration::ZERO,
        })
    }

    /// As a process, puts the fall-back out again each `time` while nothing comes; the default is
    /// the time of the timeout. Later blocks, such as a rate limit that approaches the fall-back,
    /// or a driver with a watchdog, work at that pace.
    ///
    /// # Errors
    ///
    /// It is zero.
    pub fn repeat(mut self, time: Duration) -> Result<Self, SettingError> {
        self.repeat = Of("timeout").time("repetition", time)?;
        Ok(self)
    }

    /// The longest time without a set-point.
    pub fn time(&self) -> Duration {
        self.time
    }

    /// How often the fall-back is put out.
    pub fn repetition(&self) -> Duration {
        self.repeat
    }

    /// The value to put out without set-points, in the unit of the signal.
    pub fn fallback(&self) -> f64 {
        self.fallback
    }

    /// The last set-point, or the fall-back if there was none.
    pub fn last(&self) -> f64 {
        self.last
    }

    /// Takes a set-point, or none, `elapsed` after the call before. Until the time is over the last
    /// one passes instead. A set-point that is not finite is refused, and counts as none. O(1);
    /// allocates nothing.
    pub fn step(&mut self, value: Option<f64>, elapsed: Duration) -> Verdict {
        self.silent = self.silent.saturating_add(elapsed);
        if let Some(value) = value {
            if let Some(fault) = Sample::new(value, elapsed).not_finite() {
                return Verdict::Refused(fault);
            }
            (self.last, self.silent) = (value, Duration::ZERO);
        }
        if self.silent < self.time {
            return Verdict::Pass(self.last);
        }
        Verdict::Refused(Fault::Silent {
            time: self.silent,
            limit: self.time,
        })
    }

    /// Starts again, as if a set-point had come now.
    pub fn reset(&mut self) {
        self.silent = Duration::ZERO;
    }
}
