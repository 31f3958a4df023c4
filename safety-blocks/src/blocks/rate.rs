//! Values that change no faster than they may.

use crate::block::{Block, Sample, Verdict};
use crate::fault::Fault;
use crate::setting::{Of, SettingError};
use std::time::Duration;

/// Lets a value change only so fast: what comes faster is followed at the limit.
///
/// Guards the mechanism against steps. Bound: the same sample; the change in `elapsed` is at most `rate * elapsed`, to rounding. It begins at 0
/// ([`starting_at`](Self::starting_at)), and the first sample, for which no time has passed, changes nothing. Does not see a value that is wrong and slow.
///
/// What a block before or behind it in a [`Chain`](crate::Chain) puts out instead, it is told: it goes on from there. In a chain of processes, each with a
/// block of its own, it is not: put blocks that jump (end stop, a response that holds neutral) before it there, or accept that what they release comes back at once.
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

    /// Lets `value` pass at once whenever it comes: what never harms, as a motor that is off.
    ///
    /// # Errors
    ///
    /// It is no finite number.
    pub fn free_to(mut self, value: f64) -> Result<Self, SettingError> {
        self.free = Some(Of("rate limit").finite("free value", value)?);
        Ok(self)
    }

    /// Counts a pause between samples as at most `time`: so that after a silence of a second it does not step by what a second allows.
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
