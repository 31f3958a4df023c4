//! Blocks that check whether a measurement is possible.

use crate::block::{Block, Sample, Verdict};
use crate::fault::Fault;
use crate::lasting::{Lasting, Still};
use crate::setting::{Of, SettingError};
use std::time::Duration;

/// Refuses measurements outside of `min` to `max`.
///
/// Guards against broken wires and saturated converters. Bound: the same sample. Does not detect a
/// wrong value within its range.
///
/// ```
/// use luna_safety_blocks::{Block, Range, Sample, Verdict};
/// use std::time::Duration;
///
/// let mut current = Range::new(4.0, 20.0)?; // mA
/// assert!(matches!(current.step(&Sample::new(0.1, Duration::ZERO)), Verdict::Refused(_)));
/// # Ok::<(), luna_safety_blocks::SettingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Range {
    min: f64,
    max: f64,
}

impl Range {
    /// From `min` to `max`, both included, in the unit of the signal.
    ///
    /// # Errors
    ///
    /// One is no finite number, or `min` is above `max`.
    pub fn new(min: f64, max: f64) -> Result<Self, SettingError> {
        let of = Of("range");
        Ok(Self {
            min: of.finite("min", min)?,
            max: of.number("max", max, max >= min, "a finite number, `min` or above")?,
        })
    }
}

impl Block for Range {
    fn judge(&mut self, sample: &Sample) -> Verdict {
        let Self { min, max } = *self;
        let value = sample.value;
        match (min..=max).contains(&value) {
            true => Verdict::Pass(value),
            false => Verdict::Refused(Fault::OutOfRange { value, min, max }),
        }
    }

    fn reset(&mut self) {}
}

/// Refuses measurements that the axis cannot have reached since the previous one.
///
/// Guards against jumps: lost counts, loose contacts, a counter that was reset. Bound: the same
/// sample. The next measurement is compared with the refused one, so a jump refuses only one
/// sample; use a [`Response`](crate::Response) that holds to keep the fault. Does not detect a
/// sensor that is slow, or stands still. A quantized sensor changes by a whole step between two
/// samples: allow for one step in the shortest time between samples.
///
/// ```
/// use luna_safety_blocks::{Block, MaxRate, Sample, Verdict};
/// use std::time::Duration;
///
/// let mut encoder = MaxRate::new(10.0)?; // rad/s
/// let ms = Duration::from_millis(1);
/// assert_eq!(encoder.step(&Sample::new(3.0, ms)), Verdict::Pass(3.0)); // the first can be any
/// assert_eq!(encoder.step(&Sample::new(3.009, ms)), Verdict::Pass(3.009));
/// assert!(matches!(encoder.step(&Sample::new(3.1, ms)), Verdict::Refused(_)));
/// # Ok::<(), luna_safety_blocks::SettingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct MaxRate {
    fastest: f64,
    last: Option<f64>,
}

impl MaxRate {
    /// For an axis that never moves faster than `fastest`, in the unit of the signal per second.
    ///
    /// # Errors
    ///
    /// It is not above 0, or not finite.
    pub fn new(fastest: f64) -> Result<Self, SettingError> {
        Ok(Self {
            fastest: Of("largest rate").positive("fastest", fastest)?,
            last: None,
        })
    }
}

impl Block for MaxRate {
    fn judge(&mut self, sample: &Sample) -> Verdict {
        let value = sample.value;
        let last = self.last.replace(value).unwrap_or(value);
        let rate = (value - last) / sample.elapsed.as_secs_f64();
        // Where nothing has moved no time need have passed.
        if value == last || rate.abs() <= self.fastest {
            return Verdict::Pass(value);
        }
        Verdict::Refused(Fault::TooFast {
            rate,
            limit: self.fastest,
        })
    }

    fn reset(&mut self) {
        self.last = None;
    }
}

/// Refuses a measurement that has not changed for some time.
///
/// It has changed when it is further than `band` from where it stood. Guards against a sensor or a
/// link that repeats its last value. Use it for a sensor that is never still (noise above `band`),
/// or for any other with [`while_driven`](Self::while_driven): then time counts only while the
/// feedback, which is what drives the axis, is large enough to move it.
///
/// Bound: `time` and one more sample, from the later of the last change and the first drive. No
/// false alarm while it moves by more than `band` in each `time`. Does not detect a sensor that is
/// frozen while nothing is driven; cannot distinguish a frozen sensor from a
/// [`Blocked`](crate::Blocked) axis.
///
/// ```
/// use luna_safety_blocks::{Block, Frozen, Sample, Verdict};
/// use std::time::Duration;
///
/// let ms = Duration::from_millis(1);
/// let mut pressure = Frozen::new(0.0, 20 * ms)?;
/// assert_eq!(
///     (0..).find(|_| pressure.step(&Sample::new(1.5, ms)) != Verdict::Pass(1.5)),
///     Some(20)
/// );
/// # Ok::<(), luna_safety_blocks::SettingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Frozen {
    still: Still,
    driven: Option<f64>,
}

impl Frozen {
    /// A value within `band` (in its unit) for `time` is frozen.
    ///
    /// # Errors
    ///
    /// `band` is negative or no finite number, or `time` is zero.
    pub fn new(band: f64, time: Duration) -> Result<Self, SettingError> {
        let of = Of("frozen");
        Ok(Self {
            still: Still::new(of.not_negative("band", band)?, of.time("time", time)?),
            driven: None,
        })
    }

    /// Counts only while the feedback is at least `least` in size, in its unit. Without a feedback
    /// all measurements are refused.
    ///
    /// # Errors
    ///
    /// It is not above 0, or not finite.
    pub fn while_driven(mut self, least: f64) -> Result<Self, SettingError> {
        self.driven = Some(Of("frozen").positive("least drive", least)?);
        Ok(self)
    }
}

impl Block for Frozen {
    fn judge(&mut self, sample: &Sample) -> Verdict {
        let is_driven = match (self.driven, sample.feedback) {
            (None, _) => true,
            (Some(least), Some(drive)) => drive.abs() >= least,
            (Some(_), None) => return Verdict::Refused(Fault::NoFeedback),
        };
        let value = sample.value;
        match self.still.step(value, is_driven, sample.elapsed) {
            None => Verdict::Pass(value),
            Some(time) => Verdict::Refused(Fault::Frozen { value, time }),
        }
    }

    fn reset(&mut self) {
        self.still.reset();
    }
}

/// Refuses a measurement that differs for too long from the feedback, another sensor's.
///
/// Guards against a sensor that drifts, sticks, or slips. Bound: `time` and one more sample, from
/// when they are further apart than `tolerance`; with a `time` of zero the same sample. No false
/// alarm while they are not further apart for as long as `time`. Does not detect faults common to
/// both, nor which of them is wrong.
///
/// ```
/// use luna_safety_blocks::{Block, Disagreement, Sample, Verdict};
/// use std::time::Duration;
///
/// let ms = Duration::from_millis(1);
/// let mut angles = Disagreement::new(0.01, 5 * ms)?; // rad
/// let apart = Sample::new(0.50, ms).beside(0.55);
/// assert_eq!((0..).find(|_| matches!(angles.step(&apart), Verdict::Refused(_))), Some(5));
/// # Ok::<(), luna_safety_blocks::SettingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Disagreement {
    tolerance: f64,
    time: Duration,
    apart: Lasting,
}

impl Disagreement {
    /// Two sensors that may be `tolerance` (in their unit) apart, and further for less than `time`.
    ///
    /// # Errors
    ///
    /// `tolerance` is negative or not finite.
    pub fn new(tolerance: f64, time: Duration) -> Result<Self, SettingError> {
        Ok(Self {
            tolerance: Of("disagreement").not_negative("tolerance", tolerance)?,
            time,
            apart: Lasting::default(),
        })
    }
}

impl Block for Disagreement {
    fn judge(&mut self, sample: &Sample) -> Verdict {
        let Some(other) = sample.feedback else {
            return Verdict::Refused(Fault::NoFeedback);
        };
        let (value, tolerance) = (sample.value, self.tolerance);
        let is_apart = (value - other).abs() > tolerance;
        match self.apart.step(is_apart, sample.elapsed) {
            Some(time) if time >= self.time => Verdict::Refused(Fault::Disagree {
                value,
                other,
                tolerance,
                time,
            }),
            _ => Verdict::Pass(value),
        }
    }

    fn reset(&mut self) {
        self.apart.reset();
    }
}
