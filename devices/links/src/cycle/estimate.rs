//! The offset of another computer's clock, between bounds that hold however long datagrams take.
//!
//! A datagram was sent before it was received. So of one that came from there, its stamp minus the
//! time of its arrival is a *lower* bound of the offset (their clock minus ours). Of one that went
//! there, the time of its arrival, which the partner echoes, minus its stamp is an *upper* bound.
//! Neither supposes that both ways take as long. A bound that grows old is widened by the greatest
//! drift; a new one replaces it when it is closer. The offset lies between both: the middle is the
//! estimate, and half of their distance its error.

use luna::time::Stamp;

/// Stamps are cut to whole nanoseconds, on both clocks.
const CUT: u64 = 2;

/// How far the partner's clock is ahead of this one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Offset {
    /// Their stamp minus ours of the same instant, in nanoseconds.
    pub nanos: i64,
    /// By how much that may be wrong, in nanoseconds.
    pub error: u64,
}

#[derive(Debug, Clone, Copy)]
struct Bound {
    nanos: i64,
    /// When it held, on this clock.
    at: Stamp,
}

/// What is known of the offset.
#[derive(Debug, Clone)]
pub(crate) struct OffsetBounds {
    lower: Option<Bound>,
    upper: Option<Bound>,
    drift_ppm: u32,
}

impl OffsetBounds {
    /// Both clocks keep within so many parts per million of each other.
    pub(crate) fn new(drift_ppm: u32) -> Self {
        Self {
            lower: None,
            upper: None,
            drift_ppm,
        }
    }

    /// A datagram came that was sent at `sent` there. Returns whether that contradicts what was
    /// known: a clock was set.
    pub(crate) fn came(&mut self, sent: Stamp, received: Stamp) -> bool {
        let nanos = sent.nanos_since(received);
        let new = Bound {
            nanos,
            at: received,
        };
        let before = self.lower_at(received);
        if before.is_none_or(|before| nanos >= before) {
            self.lower = Some(new);
        }
        let is_broken = self.upper_at(received).is_some_and(|upper| nanos > upper);
        if is_broken {
            (self.lower, self.upper) = (Some(new), None);
        }
        is_broken
    }

    /// A datagram that was sent at `sent` from here came there at `received`; known since `now`.
    /// Returns whether that contradicts what was known: a clock was set.
    pub(crate) fn went(&mut self, sent: Stamp, received: Stamp, now: Stamp) -> bool {
        let nanos = received.nanos_since(sent);
        let new = Bound { nanos, at: sent };
        let widened = nanos.saturating_add(self.drift(sent, now));
        let before = self.upper_at(now);
        if before.is_none_or(|before| widened <= before) {
            self.upper = Some(new);
        }
        let is_broken = self.lower_at(now).is_some_and(|lower| widened < lower);
        if is_broken {
            (self.lower, self.upper) = (None, Some(new));
        }
        is_broken
    }

    /// The offset at `now`, once datagrams have gone both ways.
    pub(crate) fn at(&self, now: Stamp) -> Option<Offset> {
        Some(middle(self.lower_at(now)?, self.upper_at(now)?))
    }

    fn lower_at(&self, now: Stamp) -> Option<i64> {
        let bound = self.lower?;
        Some(bound.nanos.saturating_sub(self.drift(bound.at, now)))
    }

    fn upper_at(&self, now: Stamp) -> Option<i64> {
        let bound = self.upper?;
        Some(bound.nanos.saturating_add(self.drift(bound.at, now)))
    }

    fn drift(&self, from: Stamp, to: Stamp) -> i64 {
        i64::try_from(drift(from, to, self.drift_ppm)).unwrap_or(i64::MAX)
    }
}

/// How far the clocks may have gone apart between two stamps of this one.
pub(crate) fn drift(from: Stamp, to: Stamp, drift_ppm: u32) -> u64 {
    let apart = to.nanos_since(from).unsigned_abs();
    let drift = u128::from(apart) * u128::from(drift_ppm);
    let drift = u64::try_from(drift.div_ceil(1_000_000)).unwrap_or(u64::MAX);
    drift.saturating_add(CUT)
}

/// Between both bounds.
fn middle(lower: i64, upper: i64) -> Offset {
    let (lower, upper) = (i128::from(lower), i128::from(upper));
    let nanos = (lower + upper).div_euclid(2);
    Offset {
        // Between two numbers of this type.
        nanos: nanos as i64,
        error: u64::try_from(upper - nanos).unwrap_or(0),
    }
}

impl Offset {
    /// As narrow as possible when the offset is also known to be 0, to within so many nanoseconds.
    /// Nothing if both contradict each other.
    pub(crate) fn also_within(self, of_zero: u64) -> Option<Offset> {
        let error = i128::from(self.error);
        let limit = i128::from(of_zero);
        let lower = (i128::from(self.nanos) - error).max(-limit);
        let upper = (i128::from(self.nanos) + error).min(limit);
        let narrow = |bound: i128| bound.clamp(i64::MIN.into(), i64::MAX.into()) as i64;
        (lower <= upper).then(|| middle(narrow(lower), narrow(upper)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Another computer's clock: ahead by `offset` at time 0, and faster by `ppb` of 1e9.
    #[derive(Debug, Clone, Copy)]
    struct There {
        offset: i64,
        ppb: i64,
    }

    const BEGIN: u64 = 1_000_000_000_000;

    /// A partner may echo any stamp.
    #[test]
    fn the_farthest_stamps_drift_no_further_than_numbers_reach() {
        let [first, last] = [0, u64::MAX].map(Stamp::from_nanos);
        for drift_ppm in [2_000_000, 2_000_001, u32::MAX] {
            assert!(drift(first, last, drift_ppm) >= u64::MAX - 2);
        }
    }

    impl There {
        fn ahead(self, now: u64) -> i64 {
            let drift = i128::from(now - BEGIN) * i128::from(self.ppb) / 1_000_000_000;
            self.offset + drift as i64
        }

        fn at(self, now: u64) -> Stamp {
            Stamp::from_nanos(now).plus_nanos(self.ahead(now))
        }
    }

    fn clocks() -> impl Strategy<Value = There> {
        let offset = prop_oneof![
            -1_000_000_i64..1_000_000,
            -900_000_000_000_i64..2_000_000_000_000_000_000,
        ];
        (offset, -100_000_i64..100_000).prop_map(|(offset, ppb)| There { offset, ppb })
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn the_offset_is_always_within_its_error(
            there in clocks(),
            // Pauses and delays in nanoseconds; what is lost on the way.
            trips in prop::collection::vec(
                (0_u64..2_000_000_000, 0_u64..50_000_000, 0_u64..50_000_000, any::<bool>()), 1..60),
        ) {
            let mut bounds = OffsetBounds::new(100);
            let mut now = BEGIN;
            for (pause, out, back, is_lost) in trips {
                now += pause;
                let (sent, received) = (Stamp::from_nanos(now), there.at(now + out));
                now += out + pause / 7;
                let answered = there.at(now);
                now += back;
                let here = Stamp::from_nanos(now);
                prop_assert!(!bounds.came(answered, here));
                prop_assert!(is_lost || !bounds.went(sent, received, here));
                if let Some(offset) = bounds.at(here) {
                    let wrong = offset.nanos.abs_diff(there.ahead(now));
                    prop_assert!(wrong <= offset.error, "{} > {}", wrong, offset.error);
                    // One way's time, in which the clocks drift too.
                    let trip = (out + back + pause / 7) / 2;
                    prop_assert!(is_lost || offset.error <= trip + trip / 1000 + 10);
                }
            }
        }

        #[test]
        fn no_stamps_make_it_panic(stamps in prop::collection::vec(any::<[u64; 3]>(), 0..20)) {
            let mut bounds = OffsetBounds::new(u32::MAX);
            for [one, two, now] in stamps.into_iter().map(|all| all.map(Stamp::from_nanos)) {
                bounds.came(one, two);
                bounds.went(one, two, now);
                let narrow = bounds.at(now).map(|offset| offset.also_within(one.as_nanos()));
                let _ = narrow;
            }
        }
    }

    #[test]
    fn a_clock_that_is_set_begins_anew() {
        let at = Stamp::from_nanos;
        let mut bounds = OffsetBounds::new(100);
        assert!(!bounds.came(at(5_000), at(1_000)));
        assert!(!bounds.went(at(900), at(5_000), at(1_000)));
        let offset = bounds.at(at(1_000)).unwrap();
        assert_eq!((offset.nanos, offset.error), (4_050, 53));
        // An hour ahead.
        assert!(bounds.came(at(3_600_000_000_000), at(2_000)));
        assert_eq!(bounds.at(at(2_000)), None);
    }

    #[test]
    fn a_claim_narrows_and_may_be_contradicted() {
        let measured = Offset {
            nanos: 100,
            error: 50,
        };
        let narrow = measured.also_within(70).unwrap();
        assert_eq!((narrow.nanos, narrow.error), (60, 10));
        assert_eq!(measured.also_within(1_000), Some(measured));
        assert_eq!(measured.also_within(49), None);
    }
}
