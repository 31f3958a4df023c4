//! How old a value is.

use luna::Instant;
use luna_platform::clock::nanos;
use std::time::Duration;

/// What two clocks of different computers may drift apart, in parts per million. The crystals of
/// computers keep 100; twice that is for two of them.
const DRIFT_PPM: u64 = 200;

/// Bounds of an age.
///
/// On one computer both are equal. Between computers nothing is assumed but that no message arrives
/// before it was sent, and that the clocks drift apart by 200 ppm at most: so the true age is
/// between the two.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct Age {
    /// It is so old, or older.
    pub at_least: Duration,
    /// It is not older. None until both links have heard each other, or if that is unknown.
    pub at_most: Option<Duration>,
}

/// A value with what is known of its age.
///
/// It is made by the [stamped receivers](crate::Endpoint::stamped_receiver). The age counts from
/// the instant at which the sending link took the value. How long it was in a buffer in front of
/// that link is not in it.
///
/// ```
/// # use luna_net::Stamped;
/// fn is_fresh(reading: &Stamped<f64>) -> bool {
///     let limit = std::time::Duration::from_millis(20);
///     reading.age().at_most.is_some_and(|age| age < limit)
/// }
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stamped<T> {
    value: T,
    number: u64,
    arrived: Instant,
    sent: Sent,
}

/// When a value was sent, by this computer's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Sent {
    pub(crate) earliest: Option<Instant>,
    pub(crate) latest: Instant,
}

impl<T> Stamped<T> {
    pub(crate) fn new(value: T, number: u64, arrived: Instant, sent: Sent) -> Self {
        Self {
            value,
            number,
            arrived,
            sent,
        }
    }

    /// The value.
    pub fn get(&self) -> &T {
        &self.value
    }

    /// Gives the value.
    pub fn into_inner(self) -> T {
        self.value
    }

    /// Its number in its channel: see [`Status::number`](crate::Status::number).
    pub fn number(&self) -> u64 {
        self.number
    }

    /// When it arrived at this computer.
    pub fn arrived(&self) -> Instant {
        self.arrived
    }

    /// How old it is now. Real-time path: yes; reads the clock.
    pub fn age(&self) -> Age {
        self.age_at(Instant::now_real())
    }

    /// How long it was under way until it arrived. Real-time path: yes.
    pub fn under_way(&self) -> Age {
        self.age_at(self.arrived)
    }

    fn age_at(&self, now: Instant) -> Age {
        Age {
            at_least: now - self.sent.latest,
            at_most: self.sent.earliest.map(|earliest| now - earliest),
        }
    }
}

/// What is known of the difference between the clocks of this computer and the partner's: here
/// minus there, in nanoseconds.
///
/// A message from there that was sent at `s` and arrives here at `a` says: difference <= a - s.
/// What the partner has seen of messages from here says the same of its side, so: difference >= s -
/// a.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ClockDifference {
    is_common: bool,
    most: Option<Bound>,
    least: Option<Bound>,
}

#[derive(Debug, Clone, Copy)]
struct Bound {
    difference: i64,
    since: Instant,
}

impl Bound {
    /// It weakens as the clocks drift apart.
    fn at(self, now: Instant) -> i64 {
        let drift = now.nanos_since(self.since) / 1_000_000 * DRIFT_PPM;
        self.difference.saturating_add_unsigned(drift)
    }
}

fn keep_least(bound: &mut Option<Bound>, difference: i64, now: Instant) {
    if bound.is_none_or(|bound| difference <= bound.at(now)) {
        let since = now;
        *bound = Some(Bound { difference, since });
    }
}

impl ClockDifference {
    /// With `is_common` the two programs have one clock.
    pub(crate) fn new(is_common: bool) -> Self {
        Self {
            is_common,
            most: None,
            least: None,
        }
    }

    /// A message that was sent at `sent` by the partner's clock has arrived now.
    pub(crate) fn arrived(&mut self, sent: u64, now: Instant) {
        let difference = now.as_nanos().wrapping_sub(sent).cast_signed();
        keep_least(&mut self.most, difference, now);
    }

    /// The partner states the same of messages from here.
    pub(crate) fn seen_there(&mut self, difference: i64, now: Instant) {
        keep_least(&mut self.least, difference, now);
    }

    /// What is to be reported to the partner.
    pub(crate) fn seen_here(&self, now: Instant) -> Option<i64> {
        self.most.map(|bound| bound.at(now))
    }

    /// When a message was sent, by this computer's clock, that arrived here at `arrived`.
    pub(crate) fn sent(&self, sent: u64, arrived: Instant) -> Sent {
        if self.is_common {
            let at = Instant::from_nanos(sent).min(arrived);
            return Sent {
                earliest: Some(at),
                latest: at,
            };
        }
        let here = |difference: i64| Instant::from_nanos(sent.saturating_add_signed(difference));
        Sent {
            earliest: self.least.map(|bound| {
                let least = bound.at(arrived).saturating_neg();
                here(least).min(arrived)
            }),
            latest: self
                .most
                .map_or(arrived, |bound| here(bound.at(arrived)).min(arrived)),
        }
    }
}

/// Nanoseconds, for tests and for messages.
pub(crate) fn now_nanos() -> u64 {
    Instant::now_real().as_nanos()
}

/// A duration as whole milliseconds, at least 1.
pub(crate) fn millis(duration: Duration) -> u64 {
    (nanos(duration) / 1_000_000).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// The partner's clock is 1 s behind. Messages from there take 2 ms, messages from here 5 ms.
    fn known(is_common: bool) -> ClockDifference {
        let mut clocks = ClockDifference::new(is_common);
        clocks.arrived(1000 * MS, Instant::from_nanos(2002 * MS));
        let (sent, arrived) = (2010_i64, 1015_i64);
        clocks.seen_there((arrived - sent) * MS as i64, Instant::from_nanos(2020 * MS));
        clocks
    }

    #[test]
    fn the_true_age_is_within_the_bounds() {
        let clocks = known(false);
        // Sent at 2030 by the clock here, arrived after 40 ms.
        let arrived = Instant::from_nanos(2070 * MS);
        let sent = clocks.sent(1030 * MS, arrived);
        let stamped = Stamped::new((), 1, arrived, sent);
        let age = stamped.under_way();
        let (least, most) = (age.at_least, age.at_most.unwrap());
        let truth = Duration::from_millis(40);
        assert!(least <= truth && truth <= most, "{age:?}");
        assert!(least >= Duration::from_millis(37), "{age:?}");
        assert!(most <= Duration::from_millis(46), "{age:?}");
    }

    #[test]
    fn bounds_weaken_with_time_and_better_ones_replace_them() {
        let mut clocks = known(false);
        let width = |clocks: &ClockDifference, at: u64| {
            let arrived = Instant::from_nanos(at * MS);
            let sent = clocks.sent((at - 1010) * MS, arrived);
            sent.latest.nanos_since(sent.earliest.unwrap())
        };
        let before = width(&clocks, 2100);
        let hour = width(&clocks, 2100 + 3_600_000);
        assert!(hour > before + 700 * MS, "{before} {hour}");
        clocks.arrived(
            1000 * MS + 3_600_000 * MS,
            Instant::from_nanos(2001 * MS + 3_600_000 * MS),
        );
        assert!(width(&clocks, 2100 + 3_600_000) < hour);
    }

    #[test]
    fn one_clock_is_exact_and_nothing_is_known_at_first() {
        let arrived = Instant::from_nanos(50);
        let sent = ClockDifference::new(true).sent(20, arrived);
        let age = Stamped::new((), 1, arrived, sent).under_way();
        assert_eq!(age.at_least, Duration::from_nanos(30));
        assert_eq!(age.at_most, Some(age.at_least));
        let sent = ClockDifference::new(false).sent(20, arrived);
        let age = Stamped::new((), 1, arrived, sent).under_way();
        assert_eq!((age.at_least, age.at_most), (Duration::ZERO, None));
    }
}
