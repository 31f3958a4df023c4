//! A value with its age.

use luna::Instant;

/// A value of an input, and how old it is.
///
/// ```
/// use luna_ethercat::Sample;
///
/// /// Goes on for three cycles without an answer, and then stops.
/// fn velocity(position: &Sample<i32>, target: i32) -> i32 {
///     match position.stale_cycles() {
///         0..=3 => target - position.held(),
///         _ => 0,
///     }
/// }
/// # let _ = velocity;
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<T> {
    pub(crate) value: T,
    pub(crate) stale: u32,
    pub(crate) sent: Instant,
    pub(crate) received: Instant,
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

    /// The times between which its frame was at the subdevice: of sending, and of the answer.
    pub fn exchanged_between(&self) -> [Instant; 2] {
        [self.sent, self.received]
    }
}
