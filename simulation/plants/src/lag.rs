//! A first-order lag, solved exactly.

use crate::single::{Single, plant_of_single};
use crate::{Plant, PlantError, Port};
use std::time::Duration;

/// A first-order lag: `T dy/dt = K u − y`. A heater, a filter, a motor's speed without its
/// armature.
///
/// Integrated exactly for a constant input: `y += (K u − y)(1 − exp(−t/T))`, so that the result
/// does not depend on the division into steps, except for rounding. It never overshoots. A step is
/// O(1), with one `exp`, and may have any length.
///
/// ```
/// use luna_plants::{Checked, FirstOrderLag, Port};
/// use std::time::Duration;
///
/// let oven = FirstOrderLag::new(
///     Port::new("power", "W"),
///     Port::new("temperature", "K"),
///     0.5,
///     Duration::from_secs(10),
/// );
/// let mut oven = Checked::new(oven);
/// oven.set("power", 200.0).unwrap();
/// oven.step(Duration::from_secs(10)).unwrap();
/// let expected = 100.0 * (1.0 - (-1.0_f64).exp());
/// assert!((oven.get("temperature").unwrap() - expected).abs() < 1e-12);
/// ```
#[derive(Debug, Clone)]
pub struct FirstOrderLag {
    single: Single,
    gain: f64,
    time_constant: f64,
}

impl FirstOrderLag {
    /// A lag at rest at 0, from `input` to `output`; `gain` is in the unit of the output divided by
    /// that of the input.
    ///
    /// # Panics
    ///
    /// If the time constant is zero, or the gain is not finite.
    #[track_caller]
    pub fn new(input: Port, output: Port, gain: f64, time_constant: Duration) -> Self {
        assert!(
            !time_constant.is_zero(),
            "a lag has a time constant above zero"
        );
        assert!(gain.is_finite(), "a lag has a finite gain");
        Self {
            single: Single::new(input, output),
            gain,
            time_constant: time_constant.as_secs_f64(),
        }
    }

    /// With the output at `value`, in its unit, instead of 0.
    #[must_use]
    pub fn starting_at(mut self, value: f64) -> Self {
        self.single.value = value;
        self
    }
}

impl Plant for FirstOrderLag {
    plant_of_single!();

    fn step(&mut self, time: Duration) -> Result<(), PlantError> {
        // Without the cancellation of 1 − exp(−x) at small x.
        let part = -(-time.as_secs_f64() / self.time_constant).exp_m1();
        let Single { applied, value, .. } = &mut self.single;
        *value += (self.gain * *applied - *value) * part;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Checked;
    use proptest::prelude::*;

    fn lag(gain: f64, time_constant: Duration, start: f64) -> Checked<FirstOrderLag> {
        let lag = FirstOrderLag::new(
            Port::new("u", "1"),
            Port::new("y", "1"),
            gain,
            time_constant,
        );
        Checked::new(lag.starting_at(start))
    }

    proptest! {
        #![proptest_config(crate::seeded())]

        #[test]
        fn steps_add_up_to_the_analytic_solution(
            gain in -10.0..10.0f64, start in -10.0..10.0f64, input in -10.0..10.0f64,
            constant in 1u64..1_000_000, steps in prop::collection::vec(1u64..1_000_000, 1..50),
        ) {
            let time_constant = Duration::from_micros(constant);
            let mut lag = lag(gain, time_constant, start);
            lag.set("u", input).unwrap();
            for &step in &steps {
                lag.step(Duration::from_micros(step)).unwrap();
            }
            let ratio = steps.iter().sum::<u64>() as f64 / constant as f64;
            let expected = gain * input + (start - gain * input) * (-ratio).exp();
            prop_assert!((lag.get("y").unwrap() - expected).abs() <= 1e-12 * (1.0 + expected.abs() + gain.abs() * input.abs()));
        }

        #[test]
        fn comes_nearer_and_never_passes(start in -10.0..10.0f64, input in -10.0..10.0f64, step in 1u64..u64::MAX) {
            let mut lag = lag(1.0, Duration::from_millis(100), start);
            lag.set("u", input).unwrap();
            let before = start - input;
            lag.step(Duration::from_nanos(step)).unwrap();
            let after = lag.get("y").unwrap() - input;
            prop_assert!(after.abs() <= before.abs() + 1e-14 && after * before >= -1e-12);
        }
    }
}
