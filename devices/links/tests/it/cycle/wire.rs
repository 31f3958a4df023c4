//! A simulated wire between two clocks, in true time: it loses, doubles, delays and so reorders.

use crate::common::Random;
use luna::Instant;
use luna::time::Stamp;
use luna_links::cycle::Moment;
use std::collections::BTreeMap;

/// When the simulation begins, in nanoseconds of true time.
pub(crate) const BEGIN: u64 = 1_000_000_000_000;

/// Which computer.
pub(crate) const HERE: usize = 0;
pub(crate) const THERE: usize = 1;

/// A computer's clock.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct SimulatedClock {
    /// Ahead of true time when the simulation begins.
    pub(crate) offset: i64,
    /// Faster than it, in parts of 1e9.
    pub(crate) ppb: i64,
}

impl SimulatedClock {
    pub(crate) fn stamp(self, now: u64) -> Stamp {
        let drift = i128::from(now - BEGIN) * i128::from(self.ppb) / 1_000_000_000;
        Stamp::from_nanos(now).plus_nanos(self.offset + drift as i64)
    }

    pub(crate) fn moment(self, now: u64) -> Moment {
        let stamp = self.stamp(now);
        Moment {
            stamp,
            instant: Instant::from_nanos(stamp.as_nanos()),
        }
    }
}

/// What the wire does to a datagram; chances are parts of 256.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Faults {
    pub(crate) lost: u8,
    pub(crate) doubled: u8,
    /// So many nanoseconds are added to one of `slow` parts.
    pub(crate) slow: u8,
    pub(crate) delay: u64,
    pub(crate) least: u64,
    pub(crate) jitter: u64,
}

impl Faults {
    pub(crate) const NONE: Faults = Faults {
        lost: 0,
        doubled: 0,
        slow: 0,
        delay: 0,
        least: 20_000,
        jitter: 0,
    };
    pub(crate) const MANY: Faults = Faults {
        lost: 20,
        doubled: 20,
        slow: 10,
        delay: 20_000_000,
        least: 20_000,
        jitter: 1_500_000,
    };
}

/// What is under way.
pub(crate) struct Wire {
    random: Random,
    faults: Faults,
    number: u64,
    /// By the time of arrival.
    under_way: BTreeMap<(u64, u64), (usize, u64, Vec<u8>)>,
}

/// A datagram that has arrived.
#[derive(Debug)]
pub(crate) struct Arrival {
    pub(crate) now: u64,
    pub(crate) to: usize,
    pub(crate) sent: u64,
    pub(crate) bytes: Vec<u8>,
}

impl Wire {
    pub(crate) fn new(random: Random, faults: Faults) -> Self {
        Self {
            random,
            faults,
            number: 0,
            under_way: BTreeMap::new(),
        }
    }

    pub(crate) fn send(&mut self, to: usize, bytes: &[u8], now: u64) {
        if self.random.chance(self.faults.lost) {
            return;
        }
        let copies = 1 + u64::from(self.random.chance(self.faults.doubled));
        for _ in 0..copies {
            let mut delay = self.faults.least + self.random.below(self.faults.jitter + 1);
            if self.random.chance(self.faults.slow) {
                delay += self.random.below(self.faults.delay);
            }
            self.number += 1;
            let key = (now + delay, self.number);
            self.under_way.insert(key, (to, now, bytes.to_vec()));
        }
    }

    /// The next one that arrives until `until`.
    pub(crate) fn next(&mut self, until: u64) -> Option<Arrival> {
        let entry = self.under_way.first_entry()?;
        let now = entry.key().0;
        (now <= until).then(|| {
            let (to, sent, bytes) = entry.remove();
            Arrival {
                now,
                to,
                sent,
                bytes,
            }
        })
    }
}
