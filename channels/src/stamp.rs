//! Stamps of choices: the basis of a fair alternative.

use core::cell::Cell;
use luna_platform::sync::plain::{AtomicU64, Ordering};

/// Stamp of an end's last choice by a fair alternative; 0 if it was never chosen.
///
/// Stamps are compared within one alternative, so each thread counts its own. An end may have come
/// from another thread: each choice gives the chosen end the greatest stamp of its alternative.
#[derive(Debug, Default)]
pub struct Stamp(AtomicU64);

luna_platform::local! {
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
        CHOICES.with(|choices| {
            let stamp = choices.get().max(greatest) + 1;
            choices.set(stamp);
            self.0.store(stamp, Ordering::Relaxed);
        });
    }
}
