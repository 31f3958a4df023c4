//! What of an axis cannot be true, or must not go on: seen from what it was told and what it measures.

use std::fmt;

/// What is wrong with an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// It was driven, and did not move.
    Blocked {
        /// For how many seconds.
        time: f64,
    },
    /// It seems to have moved faster than its motor can.
    Jump {
        /// In rad/s.
        speed: f64,
    },
    /// It cannot be calibrated.
    Calibration(super::calibration::CalibrationError),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Blocked { time } => write!(
                f,
                "it was driven for {time:.2} s and did not move; look what blocks it, at its motor and at its encoder"
            ),
            Self::Jump { speed } => write!(
                f,
                "its encoder says {speed:.1} rad/s, which the motor cannot reach; look at the encoder and its cable"
            ),
            Self::Calibration(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for Fault {}

/// A duty of at least this much moves an axis that is free.
const DRIVEN: f64 = 0.3;
/// An axis that is driven this long, in seconds, moves.
const LONGEST: f64 = 0.5;
/// What counts as moved, in rad: some tens of counts.
const MOVED: f64 = 2e-3;

/// Notices an actuator that is driven and does not move.
#[derive(Debug, Clone, Default)]
pub struct Blocked {
    /// Where it last moved to.
    at: Option<f64>,
    time: f64,
}

impl Blocked {
    /// Takes in that `duty` was given at `angle` (rad), for `sample_time` seconds. O(1); allocates nothing.
    ///
    /// # Errors
    ///
    /// [`Fault::Blocked`], half a second after the axis last moved.
    pub fn check(&mut self, duty: f64, angle: f64, sample_time: f64) -> Result<(), Fault> {
        let rests = self.at.is_some_and(|at| (angle - at).abs() <= MOVED);
        if !rests || duty.abs() < DRIVEN {
            (self.at, self.time) = (Some(angle), 0.0);
            return Ok(());
        }
        self.time += sample_time;
        match self.time > LONGEST {
            true => Err(Fault::Blocked { time: self.time }),
            false => Ok(()),
        }
    }
}

/// Notices positions that the axis cannot have reached.
#[derive(Debug, Clone)]
pub struct Plausible {
    max_speed: f64,
    last: Option<f64>,
}

impl Plausible {
    /// Of an axis that never moves faster than `max_speed` rad/s.
    pub fn new(max_speed: f64) -> Self {
        Self {
            max_speed,
            last: None,
        }
    }

    /// Takes in that the axis is at `angle` (rad), `sample_time` seconds after the call before. O(1); allocates nothing.
    ///
    /// # Errors
    ///
    /// [`Fault::Jump`].
    pub fn check(&mut self, angle: f64, sample_time: f64) -> Result<(), Fault> {
        let last = self.last.replace(angle).unwrap_or(angle);
        let speed = (angle - last) / sample_time;
        // What is no number is not plausible either, but where no time has passed and nothing has moved.
        match angle == last || speed.abs() <= self.max_speed {
            true => Ok(()),
            false => Err(Fault::Jump { speed }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAMPLE_TIME: f64 = 1e-3;

    #[test]
    fn an_axis_that_moves_or_is_not_driven_is_not_blocked() {
        let mut blocked = Blocked::default();
        for n in 0..5_000 {
            blocked
                .check(0.6, f64::from(n) * 1e-5, SAMPLE_TIME)
                .unwrap();
        }
        for _ in 0..5_000 {
            blocked.check(0.29, 0.05, SAMPLE_TIME).unwrap();
        }
    }

    #[test]
    fn one_that_is_driven_and_rests_is() {
        let mut blocked = Blocked::default();
        let calls = (1..).find(|_| blocked.check(-0.5, 0.3, SAMPLE_TIME).is_err());
        assert!((500..=503).contains(&calls.unwrap()), "{calls:?}");
    }

    #[test]
    fn nobody_moves_faster_than_the_motor() {
        let mut plausible = Plausible::new(10.0);
        // The first position can be any.
        plausible.check(123.0, SAMPLE_TIME).unwrap();
        plausible.check(123.009, SAMPLE_TIME).unwrap();
        plausible.check(123.009, 0.0).unwrap();
        assert!(matches!(
            plausible.check(123.020, SAMPLE_TIME),
            Err(Fault::Jump { speed }) if (speed - 11.0).abs() < 1e-6
        ));
        assert!(plausible.check(f64::NAN, SAMPLE_TIME).is_err());
    }
}
