//! The poll and the cycles of a process that have begun and not ended.

use luna_platform::clock::Instant;
use std::sync::atomic::{AtomicU64, Ordering};

/// As many cycles of a process are looked at while they last: one for each of its loops.
pub(super) const CYCLES: usize = 8;

/// When each of them began. Written by the thread that runs the process, one store each; read by
/// the thread that runs the system.
#[derive(Debug, Default)]
pub(super) struct UnderWay {
    poll: AtomicU64,
    cycles: [AtomicU64; CYCLES],
}

/// No instant of a begin is 0: the system runs then.
const NONE: u64 = 0;

impl UnderWay {
    /// A poll begins. O(1), a store.
    pub(super) fn poll_begins(&self, now: Instant) {
        self.poll.store(now.as_nanos(), Ordering::Release);
    }

    pub(super) fn poll_ends(&self) {
        self.poll.store(NONE, Ordering::Release);
    }

    /// A cycle begins. Gives its place, if there is one. O(1).
    pub(super) fn cycle_begins(&self, now: Instant) -> Option<usize> {
        let take = |place: &AtomicU64| {
            let (order, failed) = (Ordering::AcqRel, Ordering::Relaxed);
            let taken = place.compare_exchange(NONE, now.as_nanos(), order, failed);
            taken.is_ok()
        };
        self.cycles.iter().position(take)
    }

    pub(super) fn cycle_ends(&self, place: usize) {
        if let Some(place) = self.cycles.get(place) {
            place.store(NONE, Ordering::Release);
        }
    }

    /// When the poll began that is under way, if one is.
    pub(super) fn poll(&self) -> Option<Instant> {
        begun(&self.poll)
    }

    /// When the first of the cycles began that are under way.
    pub(super) fn first_cycle(&self) -> Option<Instant> {
        self.cycles.iter().filter_map(begun).min()
    }
}

fn begun(place: &AtomicU64) -> Option<Instant> {
    let nanos = place.load(Ordering::Acquire);
    (nanos != NONE).then(|| Instant::from_nanos(nanos))
}
