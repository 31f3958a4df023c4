//! Two plants, one behind the other.

use crate::error::ConnectError;
use crate::{Plant, PlantError, Port};
use std::time::Duration;

/// A plant in series with a second one: an amplifier and its motor, a process and its dead time.
///
/// In each step the second plant's inputs are the outputs of the first at the step's beginning,
/// held. That is exact if the outputs of the first hold for whole steps (a dead time of whole
/// steps), and otherwise late by half a step on average: take steps that are short compared with
/// the time constants. The values between must be finite and within the ranges of the second
/// plant's inputs. O(both).
///
/// ```
/// use luna_plants::{Checked, DeadTime, FirstOrderLag, Port, Series};
/// use std::time::Duration;
///
/// let ms = Duration::from_millis;
/// let valve = DeadTime::new(Port::new("set", "%"), Port::new("open", "%"), ms(100), ms(10));
/// let tank = FirstOrderLag::new(Port::new("open", "%"), Port::new("level", "m"), 0.02, ms(1000));
/// let mut both = Checked::new(Series::new(valve, tank)?);
/// both.set("set", 50.0).unwrap();
/// both.step(ms(100)).unwrap();
/// assert_eq!(both.get("level"), Ok(0.0)); // not before the dead time has passed
/// both.step(ms(5000)).unwrap();
/// assert!((both.get("level").unwrap() - 0.9932).abs() < 1e-4);
/// # Ok::<(), luna_plants::ConnectError>(())
/// ```
#[derive(Debug)]
pub struct Series<A, B> {
    first: A,
    second: crate::Checked<B>,
    between: Box<[f64]>,
}

impl<A: Plant, B: Plant> Series<A, B> {
    /// Connects the outputs of `first` to the inputs of `second`, in order. Allocates.
    ///
    /// # Errors
    ///
    /// [`ConnectError::Mismatch`]: the numbers or units of outputs and inputs differ. Names may
    /// differ.
    pub fn new(first: A, second: B) -> Result<Self, ConnectError> {
        let (outputs, inputs) = (first.outputs(), second.inputs());
        let fits = outputs.len() == inputs.len()
            && outputs
                .iter()
                .zip(inputs)
                .all(|(output, input)| output.unit() == input.unit());
        if !fits {
            let with_units = |ports: &[Port]| {
                let text = |port: &Port| format!("{} in {}", port.name(), port.unit());
                ports.iter().map(text).collect()
            };
            return Err(ConnectError::Mismatch {
                outputs: with_units(outputs),
                inputs: with_units(inputs),
            });
        }
        Ok(Self {
            between: vec![0.0; outputs.len()].into(),
            first,
            second: crate::Checked::new(second),
        })
    }
}

impl<A: Plant, B: Plant> Plant for Series<A, B> {
    fn inputs(&self) -> &[Port] {
        self.first.inputs()
    }

    fn outputs(&self) -> &[Port] {
        self.second.plant().outputs()
    }

    fn apply(&mut self, inputs: &[f64]) -> Result<(), PlantError> {
        self.first.apply(inputs)
    }

    fn step(&mut self, time: Duration) -> Result<(), PlantError> {
        self.between.fill(f64::NAN);
        self.first.measure(&mut self.between)?;
        for (input, &value) in self.between.iter().enumerate() {
            self.second.set_input(input, value)?;
        }
        self.second.step(time)?;
        self.first.step(time)
    }

    fn measure(&mut self, outputs: &mut [f64]) -> Result<(), PlantError> {
        outputs.copy_from_slice(self.second.outputs()?);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Checked, DeadTime, FirstOrderLag};

    fn port(name: &str, unit: &str) -> Port {
        Port::new(name, unit)
    }

    #[test]
    fn a_dead_time_of_whole_steps_before_a_lag_is_exact() {
        let ms = Duration::from_millis;
        let delay = DeadTime::new(port("u", "V"), port("v", "V"), ms(7), ms(1));
        let lag = FirstOrderLag::new(port("v", "V"), port("y", "V"), 2.0, ms(20));
        let mut both = Checked::new(Series::new(delay, lag).unwrap());
        both.set("u", 1.0).unwrap();
        for n in 1..200 {
            both.step(ms(1)).unwrap();
            let since = f64::from(n - 7).max(0.0) / 20.0;
            let expected = 2.0 * (1.0 - (-since).exp());
            assert!(
                (both.get("y").unwrap() - expected).abs() < 1e-12,
                "at {n} ms"
            );
        }
    }

    #[test]
    fn two_lags_come_nearer_to_the_analytic_response_with_the_step() {
        let us = Duration::from_micros;
        let error = |step: u64| {
            let first = FirstOrderLag::new(port("u", "V"), port("v", "V"), 1.0, us(10_000));
            let second = FirstOrderLag::new(port("v", "V"), port("y", "V"), 1.0, us(20_000));
            let mut both = Checked::new(Series::new(first, second).unwrap());
            both.set("u", 1.0).unwrap();
            for _ in 0..30_000 / step {
                both.step(us(step)).unwrap();
            }
            // 1 − (T₁ e^(−t/T₁) − T₂ e^(−t/T₂)) / (T₁ − T₂) at 30 ms.
            let expected = 1.0 + (-3.0_f64).exp() - 2.0 * (-1.5_f64).exp();
            (both.get("y").unwrap() - expected).abs()
        };
        let (coarse, fine) = (error(1000), error(100));
        assert!(coarse < 0.02 && fine < coarse / 8.0, "{coarse}, {fine}");
    }

    #[test]
    fn units_and_numbers_must_fit() {
        let lag = |from, to| FirstOrderLag::new(from, to, 1.0, Duration::from_secs(1));
        let error = Series::new(
            lag(port("u", "V"), port("speed", "rad/s")),
            lag(port("torque", "N.m"), port("y", "1")),
        );
        assert_eq!(
            error.unwrap_err().to_string(),
            "outputs (`speed in rad/s`) do not fit inputs (`torque in N.m`): as many are needed, of the same units"
        );
    }
}
