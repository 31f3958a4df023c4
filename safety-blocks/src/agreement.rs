//! Two channels that must agree.

use crate::block::{Sample, Verdict};
use crate::fault::{Channel, Fault};
use crate::lasting::Lasting;
use crate::setting::{Of, SettingError};
use std::time::Duration;

/// How many of two channels it takes to come to neutral.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Vote {
    /// 1oo2: either channel can stop. The value nearer to neutral passes, and none if one is
    /// missing. Safe if one channel fails; stops if one fails.
    OneOutOfTwo,
    /// 2oo2: both channels must agree to stop. The value further from neutral passes; if one is
    /// missing, the other alone. Continues if one channel falls silent. Other failures of one
    /// channel are only seen as a disagreement.
    TwoOutOfTwo,
}

/// Detects that two redundant channels disagree.
///
/// Guards against the failure of one of two controllers (or sensors) that compute the same value
/// independently. Bound: a missing or non-finite value is found in the same round; values further
/// apart than `tolerance` after `time` and one more round, or in the same round if `time` is zero.
/// No false alarm while they are not apart for as long as `time`. What passes always lies between
/// the two values, or between neutral and one of them. Does not detect faults common to both.
///
/// ```
/// use luna_safety_blocks::{Agreement, Verdict, Vote};
/// use std::time::Duration;
///
/// let ms = Duration::from_millis(1);
/// let mut torque = Agreement::new(Vote::OneOutOfTwo, 0.0, 0.05, 3 * ms)?;
/// assert_eq!(torque.step(Some(0.52), Some(0.50), ms), Verdict::Pass(0.50));
/// assert_eq!(torque.step(Some(0.52), Some(0.0), ms), Verdict::Pass(0.0)); // either one stops it
/// assert!(matches!(torque.step(Some(0.5), None, ms), Verdict::Refused(_)));
/// # Ok::<(), luna_safety_blocks::SettingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Agreement {
    vote: Vote,
    neutral: f64,
    tolerance: f64,
    time: Duration,
    apart: Lasting,
}

impl Agreement {
    /// Two channels that may be `tolerance` apart, and further for less than `time`. `tolerance`
    /// and `neutral` are in the unit of the signal.
    ///
    /// # Errors
    ///
    /// `neutral` is not finite; `tolerance` is not finite, or negative.
    pub fn new(
        vote: Vote,
        neutral: f64,
        tolerance: f64,
        time: Duration,
    ) -> Result<Self, SettingError> {
        let of = Of("agreement");
        Ok(Self {
            vote,
            neutral: of.finite("neutral", neutral)?,
            tolerance: of.not_negative("tolerance", tolerance)?,
            time,
            apart: Lasting::default(),
        })
    }

    /// The value that replaces refused ones, in the unit of the signal.
    pub fn neutral(&self) -> f64 {
        self.neutral
    }

    /// Judges the two values of this round, `elapsed` after the one before. O(1); allocates
    /// nothing.
    pub fn step(&mut self, a: Option<f64>, b: Option<f64>, elapsed: Duration) -> Verdict {
        let a = valid(a, Channel::A, elapsed);
        let b = valid(b, Channel::B, elapsed);
        match (a, b, self.vote) {
            (Ok(a), Ok(b), _) => self.vote(a, b, elapsed),
            (Ok(value), Err(fault), Vote::TwoOutOfTwo)
            | (Err(fault), Ok(value), Vote::TwoOutOfTwo) => Verdict::Limited(value, fault),
            (Err(fault), _, _) | (_, Err(fault), _) => Verdict::Refused(fault),
        }
    }

    fn vote(&mut self, a: f64, b: f64, elapsed: Duration) -> Verdict {
        let is_apart = (a - b).abs() > self.tolerance;
        if let Some(time) = self.apart.step(is_apart, elapsed)
            && time >= self.time
        {
            return Verdict::Refused(Fault::Disagree {
                value: a,
                other: b,
                tolerance: self.tolerance,
                time,
            });
        }
        let neutral = self.neutral;
        let a_is_nearer = (a - neutral).abs() <= (b - neutral).abs();
        Verdict::Pass(match self.vote {
            // Neutral is between them.
            Vote::OneOutOfTwo if (a < neutral) != (b < neutral) && a != neutral && b != neutral => {
                neutral
            }
            Vote::OneOutOfTwo if a_is_nearer => a,
            Vote::OneOutOfTwo => b,
            Vote::TwoOutOfTwo if a_is_nearer => b,
            Vote::TwoOutOfTwo => a,
        })
    }

    /// Forgets for how long they have been apart.
    pub fn reset(&mut self) {
        self.apart.reset();
    }
}

fn valid(value: Option<f64>, channel: Channel, elapsed: Duration) -> Result<f64, Fault> {
    let value = value.ok_or(Fault::Missing { channel })?;
    Sample::new(value, elapsed)
        .not_finite()
        .map_or(Ok(value), Err)
}
