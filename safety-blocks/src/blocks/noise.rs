//! The noise of a sensor.

use crate::block::{Block, Sample, Verdict};
use crate::fault::Fault;
use crate::setting::{Given, Of, SettingError};

/// The fewest samples: below, one outlier would be noise.
const FEWEST: u32 = 10;

/// Refuses measurements that are too noisy.
///
/// The measure is the mean size of the second difference, `|x[n] - 2 x[n-1] + x[n-2]|`, over about
/// `samples` samples (a leaky mean; each difference counts as at most twice `level`, so that an
/// outlier is not noise). Motion at a constant speed has none, an acceleration `a` has `a T^2` at a
/// period `T`, and noise within plus and minus `e` has at most `4 e`.
///
/// Guards against a loose shield, a failing supply, a converter's loose reference. No false alarm
/// while no second difference is above `level`: so for noise within `e`, accelerations up to `a`
/// and speeds up to `v` with a jitter `j` of the period, set it to at least `4 e + a T^2 + v j`.
/// Bound: noise with second differences of at least twice `level` is found within `samples` samples
/// (0.7 of it, and 2). Does not reliably detect noise between these levels, nor noise that is slow
/// compared with the samples.
///
/// ```
/// use luna_safety_blocks::{Block, Noise, Sample, Verdict};
/// use std::time::Duration;
///
/// let ms = Duration::from_millis(1);
/// let mut encoder = Noise::new(0.01, 20)?; // rad
/// let mut noisy = (0..).map(|n| if n % 2 == 0 { 0.01 } else { -0.01 });
/// let found =
///     noisy.position(|x| matches!(encoder.step(&Sample::new(x, ms)), Verdict::Refused(_)));
/// assert!(found.unwrap() < 20);
/// # Ok::<(), luna_safety_blocks::SettingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Noise {
    level: f64,
    share: f64,
    mean: f64,
    last: Option<f64>,
    /// The one before the last.
    earlier: Option<f64>,
}

impl Noise {
    /// For second differences up to `level`, in the unit of the signal, over about `samples`
    /// samples.
    ///
    /// # Errors
    ///
    /// `level` is not above 0 or not finite, or there are fewer than 10 samples.
    pub fn new(level: f64, samples: u32) -> Result<Self, SettingError> {
        let of = Of("noise");
        of.check(samples >= FEWEST, "samples", "10 or more", || {
            Given::Count(samples)
        })?;
        Ok(Self {
            level: of.positive("level", level)?,
            share: 1.0 / f64::from(samples),
            mean: 0.0,
            last: None,
            earlier: None,
        })
    }
}

impl Block for Noise {
    fn judge(&mut self, sample: &Sample) -> Verdict {
        let value = sample.value;
        let earlier = std::mem::replace(&mut self.earlier, self.last.replace(value));
        let last = self.earlier;
        if let (Some(last), Some(earlier)) = (last, earlier) {
            let difference = ((value - last) - (last - earlier)).abs();
            // `min` also bounds a difference that overflows.
            self.mean += (difference.min(2.0 * self.level) - self.mean) * self.share;
        }
        // The mean of differences that are at most the level is at most the level, except for
        // rounding.
        if self.mean <= self.level * (1.0 + 1e-9) {
            return Verdict::Pass(value);
        }
        Verdict::Refused(Fault::Noisy {
            level: self.mean,
            limit: self.level,
        })
    }

    fn reset(&mut self) {
        (self.mean, self.last, self.earlier) = (0.0, None, None);
    }
}
