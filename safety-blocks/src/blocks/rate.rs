//! Values that change no faster than they may.

use crate::block::{Block, Sample, Verdict};
use crate::fault::Fault;
use crate::setting::{Of, SettingError};
use std::time::Duration;

/// Limits the rate of change: a faster change is followed at the limit.
///
/// Guards the mechanism against steps. Bound: the same sample; the change in `elapsed` is at most
/// `rate * elapsed`, except for rounding. It begins at 0 ([`starting_at`](Self::starting_at)), and
/// the first sample, with no time elapsed, changes nothing. Does not detect a wrong value that
/// changes slowly.
///
/// A [`Chain`](crate::Chain) reports its actual output to the block, also if another block replaced
/// it: the limit continues from there. In a chain of processes with a block each, it does not:
/// there put blocks that jump (end stop, a response that holds neutral) before it, or accept that a
/// released value returns at once.
///
/// ```
/// use luna_safety_blocks::{Block, RateLimit, Sample};
/// use std::time::Duration;
///
/// let mut duty = RateLimit::new(100.0)?.free_to(0.0)?; // by second; off at once
/// let ms = Duration::from_millis(1);
/// assert_eq!(duty.step(&Sample::new(0.8, ms)).or(0.0), 0.1);
/// assert_eq!(duty.step(&Sample::new(0.8, 2 * ms)).or(0.0), 0.30000000000000004);
/// assert_eq!(duty.step(&Sample::new(0.0, ms)).or(0.0), 0.0);
/// # Ok::<(), luna_safety_blocks::SettingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct RateLimit {
    rate: f64,
    longest: Duration,
    free: Option<f64>,
    last: f64,
}

impl RateLimit {
    /// By at most `rate` in a second, in the unit of the signal.
    ///
    /// # Errors
    ///
    /// It is not above 0, or not finite.
    pub fn new(rate: f64) -> Result<Self, SettingError> {
        Ok(Self {
            rate: Of("rate limit").positive("rate", rate)?,
            longest: Duration::MAX,
            free: None,
            last: 0.0,
        })
    }

    /// Begins at `value`.
    ///
    /// # Errors
    ///
    /// It is no finite number.
    pub fn starting_at(mut self, value: f64) -> Result<Self, SettingError> {
        self.last = Of("rate limit").finite("start", value)?;
        Ok(self)
    }

    /// Lets `value` pass at once whenever it comes: a harmless value, such as 0 for a motor.
    ///
    /// # Errors
    ///
    /// It is not finite.
    pub fn free_to(mut self, value: f64) -> Result<Self, SettingError> {
        self.free = Some(Of("rate limit").finite("free value", value)?);
        Ok(self)
    }

    /// Counts a pause between samples as at most `time`, so that a second of silence does not allow
    /// the step of a second.
    ///
    /// # Errors
    ///
    /// It is zero.
    pub fn longest(mut self, time: Duration) -> Result<Self, SettingError> {
        self.longest = Of("rate limit").time("longest time", time)?;
        Ok(self)
    }
}

impl Block for RateLimit {
    fn judge(&mut self, sample: &Sample) -> Verdict {
        let Sample { value, elapsed, .. } = *sample;
        let change = self.rate * elapsed.min(self.longest).as_secs_f64();
        let before = self.last;
        let limited = match self.free == Some(value) {
            true => value,
            false => value.clamp(before - change, before + change),
        };
        self.last = limited;
        if limited == value {
            return Verdict::Pass(value);
        }
        let fault = Fault::TooFast {
            rate: (value - before).abs() / elapsed.as_secs_f64(),
            limit: self.rate,
        };
        Verdict::Limited(limited, fault)
    }

    fn reset(&mut self) {}

    fn replaced(&mut self, value: f64) {
        self.last = value;
    }
}
