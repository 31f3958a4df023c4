//! How close releases came in a recording.

use super::nanos;
use response_time_analysis::arrival::{ArrivalBound, Curve};
use std::collections::VecDeque;
use std::time::Duration;

/// How close releases came in a recording: no interval has more of them than the worst one of its
/// length had there.
#[derive(Debug, Clone)]
pub struct Seen(pub(super) Curve);

/// Distances between so many releases are kept. Beyond, the curve repeats itself.
pub(super) const PREFIX: usize = 64;

/// Releases, one after the other. It takes the same memory however many there are.
#[derive(Debug, Clone, Default)]
pub struct Releases {
    /// The last ones, in ns.
    last: VecDeque<u64>,
    /// The shortest distances of two, of three, and so on, in ns.
    nearest: Vec<u64>,
}

impl Releases {
    /// There was none.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds one, at this time since any origin. If it is before the last one, it counts as at that.
    pub fn add(&mut self, at: Duration) {
        let at = nanos(at).max(self.last.back().copied().unwrap_or_default());
        for (place, before) in self.last.iter().rev().enumerate() {
            let distance = at - before;
            match self.nearest.get_mut(place) {
                Some(nearest) => *nearest = distance.min(*nearest),
                None => self.nearest.push(distance),
            }
        }
        self.last.push_back(at);
        if self.last.len() > PREFIX {
            self.last.pop_front();
        }
    }

    /// None if they say nothing of how close others may come: there are fewer than two, or too many
    /// came at one instant.
    #[must_use]
    pub fn seen(&self) -> Option<Seen> {
        let longest = self.nearest.last().copied().unwrap_or_default();
        let distances = self.nearest.iter().map(|nanos| (*nanos).into());
        (longest > 0).then(|| Seen(Curve::new(distances.collect())))
    }
}

impl Seen {
    /// Of the instants of releases since any origin, in order: as of [`Releases`].
    #[must_use]
    pub fn of(releases: &[Duration]) -> Option<Self> {
        let mut all = Releases::new();
        releases.iter().for_each(|at| all.add(*at));
        all.seen()
    }

    /// So many come at most in this time.
    pub(super) fn count(&self, nanos: u64) -> usize {
        self.0.number_arrivals(nanos.into())
    }
}
