//! No motion into an end stop.

use crate::block::{Block, Sample, Verdict};
use crate::fault::Fault;
use crate::setting::{Of, SettingError};

/// Refuses motion into an end stop and allows motion out of it.
///
/// The value is what moves the axis (a duty, a torque, a speed): a positive one raises the
/// position, and 0 is rest. The feedback is the position. At `high` and above positive values
/// become 0, at `low` and below negative ones. Without a position all become 0.
///
/// Put it behind a [`RateLimit`](crate::RateLimit), which would otherwise continue into the stop at
/// its rate.
///
/// Guards against an axis that is driven into its stops. Bound: the same sample. It removes the
/// drive but does not brake: leave room for the distance in which the axis comes to rest, and for
/// one sample at full speed. Does not detect a wrong position, nor a motor that turns the wrong
/// way.
///
/// ```
/// use luna_safety_blocks::{Block, EndStop, Sample};
/// use std::time::Duration;
///
/// let mut stops = EndStop::new(-1.3, 1.3)?; // rad
/// let at = |angle, duty| Sample::new(duty, Duration::from_millis(1)).beside(angle);
/// assert_eq!(stops.step(&at(1.35, 0.2)).or(0.0), 0.0);
/// assert_eq!(stops.step(&at(1.35, -0.2)).or(0.0), -0.2);
/// # Ok::<(), luna_safety_blocks::SettingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct EndStop {
    low: f64,
    high: f64,
    hysteresis: f64,
    at_low: bool,
    at_high: bool,
}

impl EndStop {
    /// Stops that begin at `low` and at `high`, in the unit of the position.
    ///
    /// # Errors
    ///
    /// One is no finite number, or `low` is not below `high`.
    pub fn new(low: f64, high: f64) -> Result<Self, SettingError> {
        let of = Of("end stop");
        Ok(Self {
            low: of.finite("low", low)?,
            high: of.number("high", high, high > low, "a finite number above `low`")?,
            hysteresis: 0.0,
            at_low: false,
            at_high: false,
        })
    }

    /// An axis that has reached a stop has left it when it is further than `distance` from the
    /// beginning of the stop. Without hysteresis, noise of the position lets a drive into the stop
    /// flicker.
    ///
    /// # Errors
    ///
    /// It is negative, not finite, or not below the distance between the stops.
    pub fn hysteresis(mut self, distance: f64) -> Result<Self, SettingError> {
        self.hysteresis = Of("end stop").number(
            "hysteresis",
            distance,
            distance >= 0.0 && distance < self.high - self.low,
            "0 or above, and below the way between the stops",
        )?;
        Ok(self)
    }
}

impl Block for EndStop {
    fn judge(&mut self, sample: &Sample) -> Verdict {
        let Some(position) = sample.feedback else {
            return Verdict::Limited(0.0, Fault::NoFeedback);
        };
        let Self {
            low,
            high,
            hysteresis,
            ..
        } = *self;
        self.at_high = position >= high || self.at_high && position > high - hysteresis;
        self.at_low = position <= low || self.at_low && position < low + hysteresis;
        let value = sample.value;
        let stop = match (self.at_low && value < 0.0, self.at_high && value > 0.0) {
            (false, false) => return Verdict::Pass(value),
            (true, _) => low,
            (_, true) => high,
        };
        Verdict::Limited(0.0, Fault::EndStop { position, stop })
    }

    fn reset(&mut self) {
        (self.at_low, self.at_high) = (false, false);
    }

    fn check_neutral(&self, neutral: f64) -> Result<(), SettingError> {
        Of("end stop")
            .number("neutral", neutral, neutral == 0.0, "0, which is rest")
            .map(drop)
    }
}
