//! Values within limits.

use crate::block::{Block, Sample, Verdict};
use crate::fault::Fault;
use crate::setting::{Of, SettingError};

/// Limits a value to `min` to `max`: a value outside becomes the nearer end.
///
/// Guards against a faulty controller, a wrong gain, an invalid set-point. Bound: the same sample.
/// Does not detect a wrong value within its limits, nor fast changes.
///
/// ```
/// use luna_safety_blocks::{Block, Limit, Sample};
/// use std::time::Duration;
///
/// let mut duty = Limit::new(-0.7, 0.7)?; // parts of the supply
/// assert_eq!(duty.step(&Sample::new(-3.0, Duration::ZERO)).or(0.0), -0.7);
/// assert!(Limit::new(0.7, -0.7).is_err());
/// # Ok::<(), luna_safety_blocks::SettingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Limit {
    min: f64,
    max: f64,
}

impl Limit {
    /// From `min` to `max`, both included, in the unit of the signal.
    ///
    /// # Errors
    ///
    /// One is no finite number, or `min` is above `max`.
    pub fn new(min: f64, max: f64) -> Result<Self, SettingError> {
        let of = Of("limit");
        Ok(Self {
            min: of.finite("min", min)?,
            max: of.number("max", max, max >= min, "a finite number, `min` or above")?,
        })
    }
}

impl Block for Limit {
    fn judge(&mut self, sample: &Sample) -> Verdict {
        let Self { min, max } = *self;
        let value = sample.value;
        let limited = value.clamp(min, max);
        if limited == value {
            return Verdict::Pass(value);
        }
        Verdict::Limited(limited, Fault::OutOfRange { value, min, max })
    }

    fn reset(&mut self) {}

    fn check_neutral(&self, neutral: f64) -> Result<(), SettingError> {
        let is_within = (self.min..=self.max).contains(&neutral);
        Of("limit")
            .number("neutral", neutral, is_within, "a value within the limits")
            .map(drop)
    }
}
