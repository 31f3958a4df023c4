//! Reduces data to what a browser can draw.
//!
//! All limits refer to recorded time, so that a recording is always reduced in the same way.

use luna_logger::format::Values;

/// The samples of a signal in one span of time: the first passes at once; of the others the least
/// and greatest of each element are kept.
#[derive(Debug, Default)]
pub(crate) struct Bucket {
    span: u64,
    held: Vec<Held>,
    /// How many samples are neither gone on nor held.
    left_out: u64,
}

/// An extreme of one element, with the sample that has it.
#[derive(Debug, Clone)]
struct Held {
    extreme: f64,
    time: u64,
    bytes: Vec<u8>,
}

impl Bucket {
    /// Whether the sample passes at once. If [`is_over`](Self::is_over), [take](Self::take) the
    /// samples of the span before first.
    pub(crate) fn put(&mut self, span: u64, time: u64, values: Values<'_>) -> bool {
        if self.span != span {
            self.span = span;
            return true;
        }
        let held = |extreme| Held {
            extreme,
            time,
            bytes: values.bytes().to_vec(),
        };
        if self.held.is_empty() {
            for value in values.iter() {
                self.held
                    .extend([held(value.as_f64()), held(value.as_f64())]);
            }
            return false;
        }
        self.left_out += 1;
        for (value, extremes) in values.iter().zip(self.held.chunks_exact_mut(2)) {
            let value = value.as_f64();
            // Any number is more extreme than NaN, which the span may begin with.
            if value < extremes[0].extreme || extremes[0].extreme.is_nan() {
                extremes[0].replace(value, time, values);
            }
            if value > extremes[1].extreme || extremes[1].extreme.is_nan() {
                extremes[1].replace(value, time, values);
            }
        }
        false
    }

    /// Whether the span that it has something of is not this one.
    pub(crate) fn is_over(&self, span: u64) -> bool {
        self.span != span && !self.held.is_empty()
    }

    /// Passes the kept samples to `give`, in the order of time and each once. Returns how many are
    /// left out.
    pub(crate) fn take(&mut self, mut give: impl FnMut(u64, &[u8])) -> u64 {
        if self.held.is_empty() {
            return 0;
        }
        let in_all = self.left_out + 1;
        self.held.sort_by_key(|held| held.time);
        self.held
            .dedup_by(|one, other| one.time == other.time && one.bytes == other.bytes);
        let kept = self.held.len() as u64;
        for held in self.held.drain(..) {
            give(held.time, &held.bytes);
        }
        self.left_out = 0;
        in_all.saturating_sub(kept)
    }
}

impl Held {
    fn replace(&mut self, extreme: f64, time: u64, values: Values<'_>) {
        self.extreme = extreme;
        self.time = time;
        self.bytes.clear();
        self.bytes.extend_from_slice(values.bytes());
    }
}

/// The length of spans, and how many events pass: limits for a second of the recording.
#[derive(Debug)]
pub(crate) struct Budget {
    second: u64,
    sample_bytes: u64,
    events: u64,
    span: u64,
}

/// The shortest span, and the longest.
const SHORTEST: u64 = 200_000;
const LONGEST: u64 = 1_000_000_000;
/// The limit of bytes of samples in a second: beyond it, spans double.
const MAX_SAMPLE_BYTES: u64 = 6 << 20;
/// This many events pass in a second. Jiwy's 51 processes at 1 kHz make about half as many.
pub(crate) const MAX_EVENTS: u64 = 500_000;

impl Budget {
    pub(crate) fn new() -> Self {
        Self {
            second: 0,
            sample_bytes: 0,
            events: 0,
            span: SHORTEST,
        }
    }

    /// The span that contains `time`.
    pub(crate) fn span(&mut self, time: u64) -> u64 {
        self.advance(time);
        time / self.span
    }

    pub(crate) fn count_bytes(&mut self, bytes: u64) {
        self.sample_bytes += bytes;
        if self.sample_bytes > MAX_SAMPLE_BYTES && self.span < LONGEST {
            self.span *= 2;
            self.sample_bytes = MAX_SAMPLE_BYTES / 2;
        }
    }

    /// Whether one more event may pass.
    pub(crate) fn has_event(&mut self, time: u64) -> bool {
        self.advance(time);
        self.events += 1;
        self.events <= MAX_EVENTS
    }

    /// The length of a span, in nanoseconds.
    pub(crate) fn nanos(&self) -> u64 {
        self.span
    }

    fn advance(&mut self, time: u64) {
        let second = time / 1_000_000_000;
        // Threads are merged by time, but for a round that came late.
        if second <= self.second {
            return;
        }
        if self.sample_bytes < MAX_SAMPLE_BYTES / 4 && self.span > SHORTEST {
            self.span /= 2;
        }
        (self.second, self.sample_bytes, self.events) = (second, 0, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_logger::format::Type;

    fn put(bucket: &mut Bucket, span: u64, time: u64, value: f64) -> bool {
        let bytes = value.to_le_bytes();
        bucket.put(span, time, Values::from_bytes(Type::F64, &bytes))
    }

    fn taken(bucket: &mut Bucket) -> (Vec<(u64, f64)>, u64) {
        let mut all = Vec::new();
        let left_out = bucket.take(|time, bytes| {
            all.push((time, f64::from_le_bytes(bytes.try_into().unwrap())));
        });
        (all, left_out)
    }

    #[test]
    fn one_in_a_span_goes_on() {
        let mut bucket = Bucket::default();
        for span in 1..10 {
            assert!(put(&mut bucket, span, span * 10, 1.0));
            assert!(!bucket.is_over(span + 1));
        }
        assert_eq!(taken(&mut bucket), (vec![], 0));
    }

    #[test]
    fn extremes_stay_in_the_order_of_time() {
        let mut bucket = Bucket::default();
        let values = [5.0, 1.0, 7.0, 2.0, -3.0, 4.0];
        for (time, value) in values.into_iter().enumerate() {
            assert_eq!(put(&mut bucket, 1, time as u64, value), time == 0);
        }
        assert!(bucket.is_over(2));
        assert_eq!(taken(&mut bucket), (vec![(2, 7.0), (4, -3.0)], 3));
        assert_eq!(taken(&mut bucket), (vec![], 0));
        assert!(put(&mut bucket, 2, 9, 0.0));
    }

    #[test]
    fn extremes_after_nan_are_those_of_the_numbers() {
        let mut bucket = Bucket::default();
        for (time, value) in [0.0, f64::NAN, 5.0, -3.0, f64::NAN, 1.0]
            .into_iter()
            .enumerate()
        {
            assert_eq!(put(&mut bucket, 1, time as u64, value), time == 0);
        }
        assert_eq!(taken(&mut bucket), (vec![(2, 5.0), (3, -3.0)], 3));
    }

    #[test]
    fn one_held_is_given_once() {
        let mut bucket = Bucket::default();
        assert!(put(&mut bucket, 1, 1, 5.0));
        assert!(!put(&mut bucket, 1, 2, f64::NAN));
        assert_eq!(taken(&mut bucket).0.len(), 1);
        assert!(!put(&mut bucket, 1, 3, f64::NAN));
        assert!(!put(&mut bucket, 1, 4, 8.0));
        assert!(taken(&mut bucket).0.contains(&(4, 8.0)));
    }

    #[test]
    fn spans_grow_with_what_comes_and_shrink_again() {
        let mut budget = Budget::new();
        budget.span(0);
        budget.count_bytes(MAX_SAMPLE_BYTES + 1);
        assert_eq!(budget.nanos(), 2 * SHORTEST);
        for second in 1..4 {
            budget.span(second * 1_000_000_000);
        }
        assert_eq!(budget.nanos(), SHORTEST);
    }

    #[test]
    fn events_have_a_limit_in_each_second() {
        let mut budget = Budget::new();
        let gone_on = (0..MAX_EVENTS + 7).filter(|_| budget.has_event(5)).count();
        assert_eq!(gone_on as u64, MAX_EVENTS);
        assert!(budget.has_event(1_000_000_000));
    }
}
