//! The deviation of an axis from its target.

/// The error of an axis, summed up as it runs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tracking {
    samples: u64,
    squares: f64,
    max: f64,
}

impl Tracking {
    /// Takes in one error. O(1); allocates nothing.
    pub fn add(&mut self, error: f64) {
        self.samples += 1;
        self.squares += error * error;
        self.max = self.max.max(error.abs());
    }

    /// How many errors there were.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// The root of the mean square, in the unit of what was added; 0 without any.
    pub fn rms(&self) -> f64 {
        (self.squares / self.samples.max(1) as f64).sqrt()
    }

    /// The largest, either way.
    pub fn max(&self) -> f64 {
        self.max
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_no_error() {
        assert_eq!(
            (Tracking::default().rms(), Tracking::default().max()),
            (0.0, 0.0)
        );
    }

    #[test]
    fn sums_up_both_ways() {
        let mut tracking = Tracking::default();
        for error in [3.0, -4.0, 0.0, 0.0] {
            tracking.add(error);
        }
        assert_eq!((tracking.rms(), tracking.max()), (2.5, 4.0));
        assert_eq!(tracking.samples(), 4);
    }
}
