//! Faults of an axis: impossible measurements and missing motion, judged by its commands and
//! measurements.

use luna_safety_blocks::{Blocked, Fault as Found, MaxRate, SettingError};
use std::fmt;
use std::time::Duration;

/// A fault of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// What a safety block found.
    Found(Found),
    /// It cannot be calibrated.
    Calibration(super::calibration::CalibrationError),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Found(Found::Blocked { time, .. }) => write!(
                f,
                "it was driven for {:.2} s and did not move; check what blocks it, its motor and its encoder",
                time.as_secs_f64()
            ),
            Self::Found(Found::TooFast { rate, .. }) => write!(
                f,
                "its encoder measures {rate:.1} rad/s, which the motor cannot reach; check the encoder and its cable"
            ),
            Self::Found(fault) => fault.fmt(f),
            Self::Calibration(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for Fault {}

/// A duty of at least this much moves an axis that is free.
const DRIVEN: f64 = 0.3;
/// An axis that is driven this long moves.
const LONGEST: Duration = Duration::from_millis(500);
/// What counts as moved, in rad: some tens of counts.
const MOVED: f64 = 2e-3;

/// Detects an actuator that is driven and does not move, half a second after it last moved.
///
/// # Errors
///
/// None: its parameters are valid.
pub fn motion() -> Result<Blocked, SettingError> {
    Blocked::new(DRIVEN, MOVED, LONGEST)
}

/// Detects positions of an axis that it cannot have reached, because it never moves faster than
/// `max_speed` rad/s.
///
/// # Errors
///
/// `max_speed` is not a finite number above 0.
pub fn encoder(max_speed: f64) -> Result<MaxRate, SettingError> {
    MaxRate::new(max_speed)
}
