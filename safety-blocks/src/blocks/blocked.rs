//! An actuator that is driven and does not move.

use crate::block::{Block, Sample, Verdict};
use crate::fault::Fault;
use crate::lasting::Still;
use crate::setting::{Of, SettingError};
use std::time::Duration;

/// Refuses an output that has driven an axis for some time without moving it.
///
/// The value is the output, the feedback the position. The axis is driven by an output of at least
/// `driven` in size, in either direction: choose one that surely moves the free axis. It has moved
/// when its position is further than `moved` from where it stood. Guards against a jammed
/// mechanism, a dead motor or bridge, a coupling that slips before the encoder, an encoder that
/// stands still.
///
/// Bound: `time` and one more sample, from the later of the last motion and the first drive. No
/// false alarm while a driven axis moves by more than `moved` in each `time`. Does not detect an
/// axis that is blocked while driven by less, nor whether motor or encoder is at fault. An axis
/// held against a stop or a load on purpose counts as blocked too: omit the block there, or let an
/// [`EndStop`](crate::EndStop) of the same [`Chain`](crate::Chain) remove the drive.
///
/// The chain reports the actual output to the block: while that is neutral nothing is driven. So
/// with [`Recovery::After`](crate::Recovery::After) a blocked axis is tried again after that time.
///
/// ```
/// use luna_safety_blocks::{Block, Blocked, Sample, Verdict};
/// use std::time::Duration;
///
/// let ms = Duration::from_millis(1);
/// let mut motor = Blocked::new(0.3, 2e-3, 500 * ms)?; // duty, rad
/// let jammed = Sample::new(-0.5, ms).beside(0.3);
/// assert_eq!((0..).find(|_| matches!(motor.step(&jammed), Verdict::Refused(_))), Some(500));
/// # Ok::<(), luna_safety_blocks::SettingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Blocked {
    driven: f64,
    still: Still,
}

impl Blocked {
    /// Driven by `driven` or more (the unit of the output), not moved by more than `moved` (the
    /// unit of the position), for `time`.
    ///
    /// # Errors
    ///
    /// `driven` is not above 0, `moved` is negative, one is not finite, or `time` is zero.
    pub fn new(driven: f64, moved: f64, time: Duration) -> Result<Self, SettingError> {
        let of = Of("blocked actuator");
        Ok(Self {
            driven: of.positive("driven", driven)?,
            still: Still::new(of.not_negative("moved", moved)?, of.time("time", time)?),
        })
    }
}

impl Block for Blocked {
    fn judge(&mut self, sample: &Sample) -> Verdict {
        let Some(position) = sample.feedback else {
            return Verdict::Refused(Fault::NoFeedback);
        };
        let output = sample.value;
        let is_driven = output.abs() >= self.driven;
        match self.still.step(position, is_driven, sample.elapsed) {
            None => Verdict::Pass(output),
            Some(time) => Verdict::Refused(Fault::Blocked {
                output,
                position,
                time,
            }),
        }
    }

    fn reset(&mut self) {
        self.still.reset();
    }

    fn replaced(&mut self, value: f64) {
        self.still.drive(value.abs() >= self.driven);
    }
}
