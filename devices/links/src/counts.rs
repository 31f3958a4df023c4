//! What a link has done so far.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Counters of a link since it was created. Cloning is cheap. Reading is possible at any time, on
/// the real-time path too: O(1), one load.
///
/// ```
/// let counts = luna_links::Counts::default(); // of no link
/// assert_eq!((counts.records(), counts.bad(), counts.late()), (0, 0, 0));
/// ```
#[derive(Clone, Default)]
pub struct Counts(Arc<Inner>);

#[derive(Default)]
struct Inner {
    records: AtomicU64,
    bad: AtomicU64,
    refused: AtomicU64,
    connections: AtomicU64,
    late: AtomicU64,
    longest: AtomicU64,
}

impl Counts {
    /// The number of complete records, events or transactions.
    pub fn records(&self) -> u64 {
        self.0.records.load(Ordering::Relaxed)
    }

    /// Broken records received: garbled, cut off, too long. [`OnBad`](crate::OnBad) determines what
    /// is done with them.
    pub fn bad(&self) -> u64 {
        self.0.bad.load(Ordering::Relaxed)
    }

    /// How often the peer of a UDP link refused a packet, since no program listens there. The system
    /// reports that to the link that uses the socket next, a reader or a writer: add up both.
    pub fn refused(&self) -> u64 {
        self.0.refused.load(Ordering::Relaxed)
    }

    /// The number of TCP connections made.
    pub fn connections(&self) -> u64 {
        self.0.connections.load(Ordering::Relaxed)
    }

    /// The number of transactions that took longer than the driver's `late_after`.
    pub fn late(&self) -> u64 {
        self.0.late.load(Ordering::Relaxed)
    }

    /// The longest that a transaction took, late or not.
    pub fn longest(&self) -> Duration {
        Duration::from_nanos(self.0.longest.load(Ordering::Relaxed))
    }

    pub(crate) fn record(&self) {
        self.0.records.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn one_bad(&self) {
        self.0.bad.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn one_refused(&self) {
        self.0.refused.fetch_add(1, Ordering::Relaxed);
    }

    #[cfg(feature = "net")]
    pub(crate) fn connection(&self) {
        self.0.connections.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a transaction of this time.
    pub(crate) fn took(&self, time: Duration, late_after: Duration) {
        self.record();
        let nanos = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        self.0.longest.fetch_max(nanos, Ordering::Relaxed);
        if time > late_after {
            self.0.late.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl fmt::Debug for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Counts")
            .field("records", &self.records())
            .field("bad", &self.bad())
            .field("refused", &self.refused())
            .field("connections", &self.connections())
            .field("late", &self.late())
            .field("longest", &self.longest())
            .finish()
    }
}
