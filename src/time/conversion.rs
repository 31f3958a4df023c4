//! Between the stamps of a clock and the instants of the loops.

use super::{Instant, Stamp};
use std::time::Duration;

/// How the stamps of a clock and instants belong together, with the error of that: measured by
/// [`StampSource::conversion`](super::StampSource::conversion).
///
/// Both clocks go at the same rate, so it holds until TAI is set. Measure anew now and then.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Conversion {
    /// A stamp minus its instant.
    offset: i64,
    error: u64,
}

impl Conversion {
    /// Reads the one clock before and after the other, a few times, and keeps the closest.
    pub(super) fn measured(
        mut instant: impl FnMut() -> u64,
        mut stamp: impl FnMut() -> u64,
    ) -> Self {
        let mut best = Self {
            offset: 0,
            error: u64::MAX,
        };
        for _ in 0..5 {
            let before = instant();
            let between = stamp();
            let taken = instant().saturating_sub(before);
            // Rounded up: half a nanosecond is an error too.
            let error = taken.div_ceil(2);
            if error < best.error {
                let middle = before.saturating_add(taken / 2);
                best = Self {
                    offset: Stamp::from_nanos(between).nanos_since(Stamp::from_nanos(middle)),
                    error,
                };
            }
        }
        best
    }

    /// The stamp of an instant.
    pub fn stamp(&self, instant: Instant) -> Stamp {
        Stamp::from_nanos(instant.as_nanos()).plus_nanos(self.offset)
    }

    /// The instant of a stamp; saturates at the clock's origin.
    pub fn instant(&self, stamp: Stamp) -> Instant {
        let nanos = stamp.plus_nanos(self.offset.saturating_neg()).as_nanos();
        Instant::from_nanos(nanos)
    }

    /// By how much both may be wrong.
    pub fn error(&self) -> Duration {
        Duration::from_nanos(self.error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::cell::{Cell, RefCell};

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        /// Two clocks an offset apart, with readings that take time.
        #[test]
        fn a_conversion_is_within_its_error(
            offset in -1_000_000_000_000_i64..2_000_000_000_000_000_000,
            costs in prop::collection::vec(0_u64..10_000, 15),
        ) {
            let now = Cell::new(2_000_000_000_000_u64);
            let mut costs = costs.into_iter().cycle();
            let costs = RefCell::new(&mut costs);
            let read = || {
                now.set(now.get() + costs.borrow_mut().next().unwrap_or(0));
                now.get()
            };
            let measured = Conversion::measured(read, || read().saturating_add_signed(offset));
            prop_assert!(measured.offset.abs_diff(offset) <= measured.error);
            let instant = Instant::from_nanos(5_000_000_000_000);
            prop_assert_eq!(measured.instant(measured.stamp(instant)), instant);
        }
    }
}
