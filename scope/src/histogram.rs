//! How often a loop was how late, in bounded memory and for as long as it runs.

/// Each octave has so many parts: a value is known to a sixteenth.
const PARTS: usize = 16;
const PARTS_LOG: u32 = PARTS.ilog2();
/// Up to 2^38 ns, 275 s; what is longer counts as that.
const OCTAVES: usize = 38;

/// Counts of nanoseconds. The page knows the bounds of its parts by the same rule.
#[derive(Debug, Clone)]
pub(crate) struct Histogram {
    counts: Box<[u64]>,
    count: u64,
    most: u64,
}

impl Histogram {
    pub(crate) fn new() -> Self {
        Self {
            counts: vec![0; PARTS * (OCTAVES - PARTS_LOG as usize + 1)].into(),
            count: 0,
            most: 0,
        }
    }

    pub(crate) fn add(&mut self, nanos: u64) {
        let at = part(nanos).min(self.counts.len() - 1);
        self.counts[at] += 1;
        self.count += 1;
        self.most = self.most.max(nanos);
    }

    pub(crate) fn count(&self) -> u64 {
        self.count
    }

    pub(crate) fn most(&self) -> u64 {
        self.most
    }

    /// So large a share of all values is not above this: the upper bound of the part where that is so, at most the greatest value.
    pub(crate) fn quantile(&self, share: f64) -> u64 {
        let wanted = (self.count as f64 * share).ceil() as u64;
        let mut seen = 0;
        for (at, count) in self.counts.iter().enumerate() {
            seen += count;
            if seen >= wanted && *count > 0 {
                return (lower_bound(at + 1) - 1).min(self.most);
            }
        }
        self.most
    }

    /// The parts that are not empty, with their counts.
    pub(crate) fn parts(&self) -> impl Iterator<Item = (usize, u64)> + '_ {
        let counted = |(at, count): (usize, &u64)| (*count > 0).then_some((at, *count));
        self.counts.iter().enumerate().filter_map(counted)
    }
}

/// The part of a value: below 32 one for each, then 16 an octave.
fn part(nanos: u64) -> usize {
    let octave = nanos.max(1).ilog2();
    if octave <= PARTS_LOG {
        return nanos as usize;
    }
    let shift = octave - PARTS_LOG;
    shift as usize * PARTS + (nanos >> shift) as usize
}

/// The least value of a part.
fn lower_bound(at: usize) -> u64 {
    if at < 2 * PARTS {
        return at as u64;
    }
    let shift = at / PARTS - 1;
    ((at - shift * PARTS) as u64) << shift
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_follow_each_other_without_a_gap() {
        for at in 0..PARTS * 30 {
            let (from, to) = (lower_bound(at), lower_bound(at + 1));
            assert!(from < to, "{at}");
            assert_eq!((part(from), part(to - 1), part(to)), (at, at, at + 1));
        }
    }

    #[test]
    fn quantiles_are_right_to_a_sixteenth() {
        let mut histogram = Histogram::new();
        for nanos in 1..=100_000 {
            histogram.add(nanos);
        }
        assert_eq!((histogram.count(), histogram.most()), (100_000, 100_000));
        for (share, exact) in [(0.5, 50_000.0), (0.99, 99_000.0), (1.0, 100_000.0)] {
            let found = histogram.quantile(share) as f64;
            assert!(
                (exact..=exact * 17.0 / 16.0).contains(&found),
                "{share}: {found}"
            );
        }
        assert_eq!(
            histogram.parts().map(|(_, count)| count).sum::<u64>(),
            100_000
        );
    }

    #[test]
    fn nothing_is_too_long() {
        let mut histogram = Histogram::new();
        histogram.add(u64::MAX);
        assert_eq!((histogram.count(), histogram.most()), (1, u64::MAX));
        assert_eq!(histogram.parts().count(), 1);
        assert_eq!(Histogram::new().quantile(0.5), 0);
    }
}
