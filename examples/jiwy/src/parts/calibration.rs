//! Finds the encoder's count at angle 0, by driving the axis against both of its end stops.
//!
//! An incremental encoder counts from its position at power-up. The stops are at equal distances
//! from angle 0, so that it is their middle.

/// The duty that drives the axis towards a stop: well above friction, well below damage.
const DUTY: f64 = 0.15;
/// An axis that is driven is at a stop when it has moved by less than [`STILL`] rad for this long,
/// in seconds.
const STILL_TIME: f64 = 0.1;
/// See [`STILL_TIME`], in rad: some tens of counts.
const STILL: f64 = 2e-3;
/// A stop that is not found within this time, in seconds, is not there.
const LONGEST: f64 = 20.0;
/// The tolerance for the distance between the stops, in rad.
const TOLERANCE: f64 = 0.05;

/// The stop that it drives to, and the results so far.
#[derive(Debug, Clone, Copy, PartialEq)]
enum State {
    Lower,
    Upper { lower: f64 },
    Done { zero: f64 },
}

/// The next action for the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// Drive it by this duty, whatever the set-point is.
    Drive(f64),
    /// It is calibrated: its angle in rad, 0 half way between the stops.
    At(f64),
}

/// Why an axis cannot be calibrated.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// The axis still moved after the longest time that the way to a stop can take.
    #[error(
        "no end stop was reached within {LONGEST} s; check that the motor is coupled to the axis"
    )]
    NoStop,
    /// The distance between the stops is wrong: something blocks the axis, or the encoder counts
    /// wrong.
    #[error(
        "the end stops are {found:.3} rad apart instead of {expected:.3}; check what blocks the axis, and the encoder"
    )]
    Travel {
        /// From stop to stop, in rad.
        found: f64,
        /// What it should be.
        expected: f64,
    },
}

/// The calibration of one axis.
#[derive(Debug, Clone)]
pub struct Calibration {
    state: State,
    travel: f64,
    /// Where the axis was when it last had moved, and how long ago that was.
    still: (f64, f64),
    /// How long the stop has been looked for.
    time: f64,
}

impl Calibration {
    /// For an axis with stops that should be `travel` rad apart.
    pub fn new(travel: f64) -> Self {
        Self {
            state: State::Lower,
            travel,
            still: (f64::NAN, 0.0),
            time: 0.0,
        }
    }

    /// Of an axis that reads `zero` rad at angle 0, as is known already.
    pub fn known(zero: f64) -> Self {
        Self {
            state: State::Done { zero },
            ..Self::new(0.0)
        }
    }

    /// Takes the axis' position `raw` in rad, `sample_time` seconds after the call before. O(1);
    /// allocates nothing.
    ///
    /// # Errors
    ///
    /// There is no stop, or it is not where it should be.
    pub fn step(&mut self, raw: f64, sample_time: f64) -> Result<Step, CalibrationError> {
        let side = match self.state {
            State::Done { zero } => return Ok(Step::At(raw - zero)),
            State::Lower => -1.0,
            State::Upper { .. } => 1.0,
        };
        self.time += sample_time;
        let (at, since) = self.still;
        // A comparison with the initial NaN is false.
        if (raw - at).abs() <= STILL {
            self.still.1 = since + sample_time;
        } else {
            self.still = (raw, 0.0);
        }
        if self.still.1 >= STILL_TIME {
            (self.still, self.time) = ((f64::NAN, 0.0), 0.0);
            match self.state {
                State::Upper { lower } => {
                    let found = raw - lower;
                    if (found - self.travel).abs() > TOLERANCE {
                        return Err(CalibrationError::Travel {
                            found,
                            expected: self.travel,
                        });
                    }
                    let zero = 0.5 * (lower + raw);
                    self.state = State::Done { zero };
                    return Ok(Step::At(raw - zero));
                }
                _ => self.state = State::Upper { lower: raw },
            }
        } else if self.time > LONGEST {
            return Err(CalibrationError::NoStop);
        }
        Ok(Step::Drive(side * DUTY))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::AXES;
    use luna_plants::Motor;

    const SAMPLE_TIME: f64 = 1e-3;

    fn calibrate(
        plant: &mut Motor,
        offset: f64,
        travel: f64,
        scale: f64,
    ) -> Result<f64, CalibrationError> {
        let mut calibration = Calibration::new(travel);
        loop {
            match calibration.step(scale * plant.state().angle + offset, SAMPLE_TIME)? {
                Step::Drive(duty) => plant.drive(duty, SAMPLE_TIME),
                Step::At(angle) => return Ok(angle - plant.state().angle),
            }
        }
    }

    #[test]
    fn finds_the_middle_wherever_it_counts_from() {
        for axis in &AXES {
            for offset in [0.0, -7.3, 1234.5] {
                let mut plant = Motor::new(axis.plant);
                let error = calibrate(&mut plant, offset, 2.0 * axis.plant.end_stop, 1.0).unwrap();
                assert!(error.abs() < 2e-3, "{}: {error} rad off", axis.name);
            }
        }
    }

    #[test]
    fn what_blocks_the_axis_is_no_stop() {
        let axis = &AXES[0];
        let mut blocked = axis.plant;
        blocked.end_stop = 0.9;
        let outcome = calibrate(
            &mut Motor::new(blocked),
            0.0,
            2.0 * axis.plant.end_stop,
            1.0,
        );
        assert!(
            matches!(outcome, Err(CalibrationError::Travel { found, .. }) if (found - 1.8).abs() < 0.02),
            "{outcome:?}"
        );
    }

    #[test]
    fn an_encoder_that_counts_nothing_or_too_much_is_noticed() {
        let axis = &AXES[1];
        for scale in [0.0, 0.5, 2.0] {
            let outcome = calibrate(
                &mut Motor::new(axis.plant),
                0.0,
                2.0 * axis.plant.end_stop,
                scale,
            );
            assert!(
                matches!(outcome, Err(CalibrationError::Travel { .. })),
                "{scale}: {outcome:?}"
            );
        }
    }

    #[test]
    fn an_axis_without_stops_is_given_up() {
        let mut calibration = Calibration::new(2.8);
        let outcome = (0..)
            .map(|n| calibration.step(f64::from(n) * 0.01, SAMPLE_TIME))
            .find(Result::is_err);
        assert_eq!(outcome, Some(Err(CalibrationError::NoStop)));
    }

    #[test]
    fn what_is_known_is_not_looked_for() {
        assert_eq!(
            Calibration::known(0.5).step(0.75, SAMPLE_TIME),
            Ok(Step::At(0.25))
        );
    }
}
