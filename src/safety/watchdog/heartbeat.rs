//! The state of a watchdog: when it was fed last, in one word.

use luna_platform::clock::{Instant, nanos};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// The watch has not begun.
const NOT_STARTED: u64 = 0;
/// Set when it has expired, beside the last feed. No instant reaches it: the clock would run for
/// 292 years.
const EXPIRED: u64 = 1 << 63;
/// The watch is over, and there was no expiry. No expiry is this word, since times are smaller.
const RETIRED: u64 = u64::MAX;

fn is_expired(last: u64) -> bool {
    last & EXPIRED != 0 && last != RETIRED
}

/// An instant in the word.
fn time(now: Instant) -> u64 {
    now.as_nanos().min(EXPIRED - 2)
}

/// When a watchdog was fed last, and whether it has expired since. One word, which each step
/// changes by one compare-and-swap: so an expiry and a feed have an order, and the thread that
/// marks the expiry has seen that there was no feed in time. The times in it only rise, so no two
/// expiries are the same word.
#[derive(Debug)]
pub(super) struct Heartbeat {
    last: AtomicU64,
    timeout: u64,
}

impl Heartbeat {
    pub(super) fn new(timeout: Duration) -> Self {
        Self {
            last: AtomicU64::new(NOT_STARTED),
            // At least the clock's resolution.
            timeout: nanos(timeout).max(1),
        }
    }

    pub(super) fn timeout(&self) -> Duration {
        Duration::from_nanos(self.timeout)
    }

    /// Its expiry, if it has expired: each is another number.
    pub(super) fn expiry(&self) -> Option<u64> {
        let last = self.last.load(Ordering::Acquire);
        is_expired(last).then_some(last)
    }

    /// Feeds at `now`, if it is not too late. Repeats only when another feed was counted meanwhile,
    /// of a thread that had begun before.
    #[inline]
    pub(super) fn feed(&self, now: Instant) {
        self.change(|last| match last {
            NOT_STARTED => Some(time(now)),
            RETIRED => None,
            last if is_expired(last) => None,
            // A feed does not undo the silence before it, even if no thread has looked yet.
            last if self.is_over(last, now) => Some(last | EXPIRED),
            // The thread was preempted between its look at the clock and here.
            last if time(now) <= last => None,
            _ => Some(time(now)),
        });
    }

    /// Ends the watch at `now`, for good; an expiry stays. Returns whether it did.
    pub(super) fn retire(&self, now: Instant) -> bool {
        let last = self.change(|last| match last {
            RETIRED => None,
            NOT_STARTED => Some(RETIRED),
            last if is_expired(last) => None,
            // As for a late feed: the silence before it counts.
            last if self.is_over(last, now) => Some(last | EXPIRED),
            _ => Some(RETIRED),
        });
        last == RETIRED
    }

    /// Whether the watch is over without an expiry.
    pub(super) fn is_retired(&self) -> bool {
        self.last.load(Ordering::Acquire) == RETIRED
    }

    /// Looks at `now`. Returns when it will expire if it is not fed; `None` if it has expired.
    /// Begins the watch.
    pub(super) fn look(&self, now: Instant) -> Option<Instant> {
        let last = self.change(|last| match last {
            NOT_STARTED => Some(time(now)),
            RETIRED => None,
            last if is_expired(last) => None,
            last => self.is_over(last, now).then_some(last | EXPIRED),
        });
        if last == RETIRED {
            return Some(Instant::NEVER);
        }
        // A feed at the very end of the time is in time; one nanosecond later it is over.
        (!is_expired(last))
            .then(|| Instant::from_nanos(last).plus_nanos(self.timeout.saturating_add(1)))
    }

    /// Forgets all, and begins a new watch at `now`.
    pub(super) fn reset(&self, now: Instant) {
        self.change(|last| match last {
            RETIRED => None,
            last if is_expired(last) => Some(time(now).max((last & !EXPIRED) + 1)),
            // The thread was preempted since its look at the clock: a later feed stays.
            last => (last < time(now)).then_some(time(now)),
        });
    }

    fn is_over(&self, last: u64, now: Instant) -> bool {
        now.nanos_since(Instant::from_nanos(last)) > self.timeout
    }

    /// Makes one step, if `step` returns one. Returns the state after it.
    #[inline]
    fn change(&self, step: impl Fn(u64) -> Option<u64>) -> u64 {
        let mut last = self.last.load(Ordering::Acquire);
        while let Some(next) = step(last) {
            match self
                .last
                .compare_exchange(last, next, Ordering::AcqRel, Ordering::Acquire)
            {
                Ok(_) => return next,
                Err(other) => last = other,
            }
        }
        last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(nanos: u64) -> Instant {
        Instant::from_nanos(nanos)
    }

    fn watched_from(now: u64) -> Heartbeat {
        let heartbeat = Heartbeat::new(Duration::from_nanos(10));
        assert_eq!(heartbeat.look(at(now)), Some(at(now + 11)));
        heartbeat
    }

    #[test]
    fn expires_when_the_time_has_passed_and_not_before() {
        let heartbeat = watched_from(100);
        assert_eq!(heartbeat.look(at(110)), Some(at(111)));
        assert_eq!(heartbeat.expiry(), None);
        assert_eq!(heartbeat.look(at(111)), None);
        assert!(heartbeat.expiry().is_some());
    }

    #[test]
    fn a_feed_in_time_puts_it_off() {
        let heartbeat = watched_from(100);
        heartbeat.feed(at(110));
        assert_eq!(heartbeat.look(at(111)), Some(at(121)));
        assert_eq!(heartbeat.look(at(120)), Some(at(121)));
        assert_eq!(heartbeat.look(at(121)), None);
    }

    #[test]
    fn a_feed_too_late_expires_before_any_look() {
        let heartbeat = watched_from(100);
        heartbeat.feed(at(111));
        assert!(heartbeat.expiry().is_some());
        assert_eq!(heartbeat.look(at(112)), None);
    }

    #[test]
    fn it_stays_expired_until_it_is_reset() {
        let heartbeat = watched_from(100);
        assert_eq!(heartbeat.look(at(200)), None);
        heartbeat.feed(at(201));
        assert_eq!(heartbeat.look(at(202)), None);
        heartbeat.reset(at(300));
        assert_eq!(heartbeat.look(at(300)), Some(at(311)));
        assert_eq!(heartbeat.expiry(), None);
    }

    /// So that a waiter that was called for one expiry is called for the next, though no thread has
    /// looked in between.
    #[test]
    fn no_two_expiries_are_the_same() {
        let heartbeat = watched_from(100);
        let mut expiries = std::collections::BTreeSet::new();
        for resets_at in [111, 111, 0, 200, 200] {
            assert_eq!(heartbeat.look(at(1000)), None);
            assert!(expiries.insert(heartbeat.expiry().unwrap()));
            heartbeat.reset(at(resets_at));
            assert_eq!(heartbeat.expiry(), None);
        }
    }

    #[test]
    fn a_reset_that_was_held_up_takes_nothing_from_a_later_feed() {
        let heartbeat = watched_from(100);
        heartbeat.feed(at(108));
        heartbeat.reset(at(103));
        assert_eq!(heartbeat.look(at(110)), Some(at(119)));
    }

    #[test]
    fn a_retired_one_never_expires_and_an_expired_one_cannot_be_retired() {
        for has_begun in [false, true] {
            let heartbeat = match has_begun {
                true => watched_from(100),
                false => Heartbeat::new(Duration::from_nanos(10)),
            };
            assert!(heartbeat.retire(at(110)));
            heartbeat.feed(at(111));
            heartbeat.reset(at(112));
            assert_eq!(heartbeat.look(at(1000)), Some(Instant::NEVER));
            assert!(heartbeat.is_retired() && heartbeat.expiry().is_none());
        }
        // No thread has looked: the silence before counts all the same.
        let heartbeat = watched_from(100);
        assert!(!heartbeat.retire(at(111)) && !heartbeat.retire(at(112)));
        assert!(!heartbeat.is_retired() && heartbeat.expiry().is_some());
        assert_eq!(heartbeat.look(at(113)), None);
    }

    #[test]
    fn the_watch_begins_with_the_first_look_or_feed() {
        let heartbeat = Heartbeat::new(Duration::from_nanos(10));
        heartbeat.feed(at(1000));
        assert_eq!(heartbeat.look(at(1005)), Some(at(1011)));
        assert_eq!(watched_from(5000).look(at(5001)), Some(at(5011)));
    }

    #[test]
    fn a_feed_that_was_held_up_takes_nothing_from_a_later_one() {
        let heartbeat = watched_from(100);
        heartbeat.feed(at(108));
        heartbeat.feed(at(103));
        assert_eq!(heartbeat.look(at(110)), Some(at(119)));
    }

    #[test]
    fn timeouts_at_the_ends_of_the_clock() {
        let heartbeat = Heartbeat::new(Duration::ZERO);
        assert_eq!(heartbeat.look(at(5)), Some(at(7)));
        let heartbeat = Heartbeat::new(Duration::MAX);
        assert_eq!(heartbeat.look(at(5)), Some(Instant::NEVER));
        heartbeat.feed(at(u64::MAX - 2));
        assert_eq!(heartbeat.expiry(), None);
    }

    /// Many threads feed at once while one looks: if no step of the clock exceeds the timeout, it
    /// never expires.
    #[test]
    fn feeds_of_many_threads() {
        let heartbeat = Heartbeat::new(Duration::from_nanos(1_000_000));
        let clock = AtomicU64::new(1);
        heartbeat.look(at(1));
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..20_000 {
                        heartbeat.feed(at(clock.fetch_add(1, Ordering::Relaxed)));
                    }
                });
            }
            while clock.load(Ordering::Relaxed) < 80_000 {
                assert!(heartbeat.look(at(clock.load(Ordering::Relaxed))).is_some());
            }
        });
        // The latest of all feeds counts.
        assert_eq!(heartbeat.look(at(80_001)), Some(at(80_000 + 1_000_001)));
    }
}
