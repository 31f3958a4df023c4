//! When an end was last chosen: what makes a fair alternative fair.

use std::cell::Cell;
use std::sync::atomic::{AtomicU64, Ordering};

/// When an end was last chosen by a fair alternative; 0 if it never was.
///
/// Stamps are compared within one alternative, so they are counted by each thread for itself. Where
/// an end has come from another thread, choosing makes up for it: the end chosen last always has
/// the greatest stamp of its alternative.
#[derive(Debug, Default)]
pub struct Stamp(AtomicU64);

thread_local! {
    static CHOICES: Cell<u64> = const { Cell::new(0) };
}

/// Another end was never chosen.
impl Clone for Stamp {
    fn clone(&self) -> Self {
        Self::new()
    }
}

impl Stamp {
    /// Stamp of an end that was never chosen.
    pub const fn new() -> Self {
        Self(AtomicU64::new(0))
    }

    #[inline]
    pub(crate) fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }

    /// Notes that this end was chosen, among ends of which the greatest stamp is `greatest`.
    #[inline]
    pub(crate) fn choose(&self, greatest: u64) {
        let stamp = CHOICES.get().max(greatest) + 1;
        CHOICES.set(stamp);
        self.0.store(stamp, Ordering::Relaxed);
    }
}
