//! A look at a block from elsewhere.

use crate::block::Verdict;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The observable state of a running block, and its reset. Clones are handles to the same block.
///
/// From any thread; O(1), no lock; only the first call allocates.
#[derive(Debug, Clone, Default)]
pub struct Monitor(Arc<Seen>);

#[derive(Debug, Default)]
struct Seen {
    passed: AtomicU64,
    limited: AtomicU64,
    refused: AtomicU64,
    is_held: AtomicBool,
    is_reset: AtomicBool,
    is_retired: AtomicBool,
}

impl Monitor {
    /// How many samples have passed as they came.
    pub fn passed(&self) -> u64 {
        self.0.passed.load(Ordering::Relaxed)
    }

    /// How many the block has changed.
    pub fn limited(&self) -> u64 {
        self.0.limited.load(Ordering::Relaxed)
    }

    /// How many it has refused.
    pub fn refused(&self) -> u64 {
        self.0.refused.load(Ordering::Relaxed)
    }

    /// Whether neutral is held for it now.
    pub fn is_held(&self) -> bool {
        self.0.is_held.load(Ordering::Acquire)
    }

    /// Requests that the block lets values pass again. With its next sample it forgets the samples
    /// seen and its fault; if the fault is still there, it is found again.
    pub fn reset(&self) {
        self.0.is_reset.store(true, Ordering::Release);
    }

    /// States that the writers are about to end on purpose: their end is no silence. For a
    /// [timeout](crate::ChainProcess::timeout) and an [`AgreementProcess`](crate::AgreementProcess)
    /// with [`Reaction::SafeState`](crate::Reaction::SafeState) or
    /// [`Reaction::Emergency`](crate::Reaction::Emergency), before the writers end. While they
    /// exist nothing changes: a silence is found as before.
    pub fn retire(&self) {
        self.0.is_retired.store(true, Ordering::Release);
    }

    pub(crate) fn is_retired(&self) -> bool {
        self.0.is_retired.load(Ordering::Acquire)
    }

    pub(crate) fn take_reset(&self) -> bool {
        // A plain look in all cycles but one.
        self.0.is_reset.load(Ordering::Relaxed) && self.0.is_reset.swap(false, Ordering::Acquire)
    }

    pub(crate) fn note_held(&self, is_held: bool) {
        self.0.is_held.store(is_held, Ordering::Release);
    }

    pub(crate) fn count(&self, verdict: &Verdict) {
        let counter = match verdict {
            Verdict::Pass(_) => &self.0.passed,
            Verdict::Limited(..) => &self.0.limited,
            Verdict::Refused(_) => &self.0.refused,
        };
        // One writer, so no read-modify-write.
        counter.store(counter.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
    }
}
