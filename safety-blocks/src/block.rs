//! A block: a step from a sample to a verdict. It has no clock, no channel, and only its own state.

use crate::fault::{Fault, Which};
use crate::setting::{Of, SettingError};
use std::time::Duration;

/// What a block sees in one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// The value that passes through: a set-point, an output, a measurement.
    pub value: f64,
    /// The value that a block compares with, if it does: the measured position, the second sensor,
    /// the output that drives the axis.
    pub feedback: Option<f64>,
    /// The time since the sample before; zero for the first.
    pub elapsed: Duration,
}

impl Sample {
    /// A sample of `value` without feedback, `elapsed` after the one before.
    pub const fn new(value: f64, elapsed: Duration) -> Self {
        Self {
            value,
            feedback: None,
            elapsed,
        }
    }

    /// With `feedback`, in the unit that its block states.
    #[must_use]
    pub const fn beside(mut self, feedback: f64) -> Self {
        self.feedback = Some(feedback);
        self
    }

    /// What of it is no finite number.
    pub fn not_finite(&self) -> Option<Fault> {
        if !self.value.is_finite() {
            return Some(Fault::NotFinite {
                which: Which::Value,
                value: self.value,
            });
        }
        let value = self.feedback.filter(|feedback| !feedback.is_finite())?;
        Some(Fault::NotFinite {
            which: Which::Feedback,
            value,
        })
    }
}

/// A block's verdict on a sample. Every number in it that is passed on is finite.
#[derive(Debug, Clone, Copy, PartialEq)]
#[must_use = "an ignored verdict protects nothing"]
pub enum Verdict {
    /// It passes as it came.
    Pass(f64),
    /// The block has made it safe: this passes in its place.
    Limited(f64, Fault),
    /// The sample is unreliable. The [`Response`](crate::Response) determines the output.
    Refused(Fault),
}

impl Verdict {
    /// The output, if `neutral` replaces a refused value.
    pub fn or(self, neutral: f64) -> f64 {
        match self {
            Self::Pass(value) | Self::Limited(value, _) => value,
            Self::Refused(_) => neutral,
        }
    }

    /// What it found, if anything.
    pub fn fault(&self) -> Option<Fault> {
        match self {
            Self::Pass(_) => None,
            Self::Limited(_, fault) | Self::Refused(fault) => Some(*fault),
        }
    }
}

/// A safety block.
///
/// It consists of its state and parameters: a step allocates nothing, never blocks, and takes O(1).
/// Use one directly, or in a [`Chain`](crate::Chain), which adds responses to its verdicts.
///
/// ```
/// use luna_safety_blocks::{Block, Limit, Sample, Verdict};
/// use std::time::Duration;
///
/// let mut limit = Limit::new(-0.7, 0.7)?;
/// let ms = Duration::from_millis(1);
/// assert_eq!(limit.step(&Sample::new(0.5, ms)), Verdict::Pass(0.5));
/// assert_eq!(limit.step(&Sample::new(5.0, ms)).or(0.0), 0.7);
/// assert_eq!(limit.step(&Sample::new(f64::NAN, ms)).or(0.0), 0.0);
/// # Ok::<(), luna_safety_blocks::SettingError>(())
/// ```
pub trait Block {
    /// Judges a sample of finite numbers. Called by [`step`](Self::step).
    fn judge(&mut self, sample: &Sample) -> Verdict;

    /// Forgets the samples seen, but not the last output: the next sample counts as the first.
    fn reset(&mut self);

    /// Called when `value` was put out instead of this block's output: another block, or the
    /// response to a fault, has replaced it. The default does nothing.
    fn replaced(&mut self, value: f64) {
        let _ = value;
    }

    /// Checks that `neutral` may replace a refused value.
    ///
    /// # Errors
    ///
    /// It is no finite number, or this block would not let it pass.
    fn check_neutral(&self, neutral: f64) -> Result<(), SettingError> {
        Of("block").finite("neutral", neutral).map(drop)
    }

    /// Judges one sample. Numbers that are not finite are refused, and do not count as seen.
    /// Real-time path: yes; O(1), no allocation.
    fn step(&mut self, sample: &Sample) -> Verdict {
        match sample.not_finite() {
            Some(fault) => Verdict::Refused(fault),
            None => self.judge(sample),
        }
    }
}

impl<B: Block + ?Sized> Block for Box<B> {
    fn judge(&mut self, sample: &Sample) -> Verdict {
        (**self).judge(sample)
    }

    fn reset(&mut self) {
        (**self).reset();
    }

    fn replaced(&mut self, value: f64) {
        (**self).replaced(value);
    }

    fn check_neutral(&self, neutral: f64) -> Result<(), SettingError> {
        (**self).check_neutral(neutral)
    }

    fn step(&mut self, sample: &Sample) -> Verdict {
        (**self).step(sample)
    }
}
