//! A value with its age.

use luna::Instant;

/// A value of the card, and how old it is.
///
/// ```
/// use luna_mesa::{Reading, Sample};
///
/// /// Goes on for three cycles without an answer, and then stops.
/// fn duty(sample: &Sample<Reading>, target: f64) -> f64 {
///     match sample.stale_cycles() {
///         0..=3 => 1e-4 * (target - sample.held().position as f64),
///         _ => 0.0,
///     }
/// }
/// # let _ = duty;
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<T> {
    pub(crate) value: T,
    pub(crate) stale: u32,
    pub(crate) asked: Instant,
    pub(crate) answered: Instant,
}

impl<T: Copy> Sample<T> {
    /// The value, if it is from this cycle.
    pub fn fresh(&self) -> Option<T> {
        (self.stale == 0).then_some(self.value)
    }

    /// The last value, of whatever cycle. See [`stale_cycles`](Self::stale_cycles).
    pub fn held(&self) -> T {
        self.value
    }

    /// The age of the value in cycles: 0 if it is fresh.
    pub fn stale_cycles(&self) -> u32 {
        self.stale
    }

    /// The times between which it was measured: of the request, and of the answer.
    pub fn measured_between(&self) -> [Instant; 2] {
        [self.asked, self.answered]
    }
}
