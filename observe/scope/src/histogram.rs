//! How late the cycles of a loop began, in bounded memory.

/// The resolution is a sixteenth of a value (one significant digit). Values above 275 s count as
/// that.
const SIGNIFICANT_DIGITS: u8 = 1;
const LONGEST: u64 = 1 << 38;

/// Counts of nanoseconds.
#[derive(Debug, Clone)]
pub(crate) struct Histogram {
    counts: hdrhistogram::Histogram<u64>,
    /// Exact; that of `counts` is rounded up.
    max: u64,
}

impl Histogram {
    pub(crate) fn new() -> Self {
        let counts = hdrhistogram::Histogram::new_with_bounds(1, LONGEST, SIGNIFICANT_DIGITS);
        Self {
            counts: counts.expect("the bounds are valid"),
            max: 0,
        }
    }

    pub(crate) fn add(&mut self, nanos: u64) {
        self.counts.saturating_record(nanos);
        self.max = self.max.max(nanos);
    }

    /// A value that was added was another one, which is not less.
    pub(crate) fn correct(&mut self, added: u64, nanos: u64) {
        let mut one = hdrhistogram::Histogram::new_from(&self.counts);
        one.saturating_record(added);
        if self.counts.subtract(&one).is_ok() {
            self.add(nanos);
        }
    }

    pub(crate) fn count(&self) -> u64 {
        self.counts.len()
    }

    pub(crate) fn max(&self) -> u64 {
        self.max
    }

    /// The value that this share of all values does not exceed; at most the greatest value.
    pub(crate) fn quantile(&self, share: f64) -> u64 {
        self.counts.value_at_quantile(share).min(self.max)
    }

    /// The buckets that are not empty: lower bound, upper bound (exclusive), count.
    pub(crate) fn buckets(&self) -> impl Iterator<Item = (u64, u64, u64)> + '_ {
        self.counts.iter_recorded().map(|bucket| {
            let value = bucket.value_iterated_to();
            (
                self.counts.lowest_equivalent(value),
                self.counts.next_non_equivalent(value),
                bucket.count_at_value(),
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(values: impl IntoIterator<Item = u64>) -> Histogram {
        let mut histogram = Histogram::new();
        values.into_iter().for_each(|nanos| histogram.add(nanos));
        histogram
    }

    #[test]
    fn quantiles_are_right_to_a_sixteenth() {
        let histogram = of(1..=100_000);
        assert_eq!((histogram.count(), histogram.max()), (100_000, 100_000));
        for (share, exact) in [(0.5, 50_000.0), (0.99, 99_000.0), (1.0, 100_000.0)] {
            let found = histogram.quantile(share) as f64;
            assert!(
                (exact..=exact * 17.0 / 16.0).contains(&found),
                "{share}: {found}"
            );
        }
    }

    #[test]
    fn buckets_hold_all_values_and_have_no_gaps() {
        let histogram = of(0..100_000);
        let buckets: Vec<_> = histogram.buckets().collect();
        assert_eq!(buckets[0], (0, 1, 1));
        for pair in buckets.windows(2) {
            assert_eq!(pair[0].1, pair[1].0);
        }
        let full = &buckets[..buckets.len() - 1];
        assert!(full.iter().all(|(from, to, count)| to - from == *count));
        assert!(
            full.iter()
                .all(|(from, to, _)| to - from <= 1.max(from / 16))
        );
        let all: u64 = buckets.iter().map(|(_, _, count)| count).sum();
        assert_eq!(all, 100_000);
    }

    #[test]
    fn no_value_is_too_large() {
        let histogram = of([u64::MAX]);
        assert_eq!((histogram.count(), histogram.max()), (1, u64::MAX));
        assert_eq!(histogram.buckets().count(), 1);
        assert_eq!(Histogram::new().quantile(0.5), 0);
    }
}
