//! What a link counts.

use std::sync::atomic::{AtomicU64, Ordering};

macro_rules! counters {
    ($($(#[$about:meta])* $name:ident),+ $(,)?) => {
        /// Counters of a link. They can be read at any time, from any thread.
        #[derive(Debug, Default)]
        pub struct Health { $(pub(crate) $name: Counter),+ }

        impl Health {
            $($(#[$about])* pub fn $name(&self) -> u64 { self.$name.0.load(Ordering::Relaxed) })+
        }
    };
}

counters! {
    /// Cycles.
    cycles,
    /// Cycles without an answer in time.
    missed,
    /// The most of these in a row.
    longest_silence,
    /// Answers that were not used: of earlier cycles, doubled, or malformed.
    dropped,
    /// Cycles in which the card had not received the last write packet when it answered.
    writes_behind,
    /// Packets that the system refused to send, or errors that it returned in place of an answer.
    refused,
    /// Duties that were not numbers, and written as 0.
    not_finite,
}

/// Written by one process.
#[derive(Debug, Default)]
pub(crate) struct Counter(AtomicU64);

impl Counter {
    pub(crate) fn add(&self) {
        self.0
            .store(self.0.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
    }

    pub(crate) fn raise_to(&self, value: u64) {
        if value > self.0.load(Ordering::Relaxed) {
            self.0.store(value, Ordering::Relaxed);
        }
    }
}
