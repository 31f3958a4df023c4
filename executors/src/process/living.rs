//! How many processes live.

use luna_platform::clock::Instant;
use luna_platform::futex::Futex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Counts the processes that have not ended, so that one thread can wait for the last.
#[derive(Debug)]
pub struct Living {
    count: AtomicUsize,
    ended: Futex,
}

impl Living {
    /// Nobody lives yet.
    #[expect(
        clippy::new_without_default,
        reason = "shared on purpose, not by default"
    )]
    pub fn new() -> Self {
        Self {
            count: AtomicUsize::new(0),
            ended: Futex::new(0),
        }
    }

    /// How many have not ended.
    pub fn count(&self) -> usize {
        self.count.load(Ordering::Acquire)
    }

    /// A number that changes whenever a process ends or [`announce`](Self::announce) is called.
    pub fn changes(&self) -> u32 {
        self.ended.word().load(Ordering::Acquire)
    }

    /// Sleeps until the number is no longer `seen`, or until `deadline`. May return without a cause.
    pub fn wait(&self, seen: u32, deadline: Instant) {
        self.ended.wait(seen, deadline);
    }

    /// Wakes who waits. One system call.
    pub fn announce(&self) {
        self.ended.word().fetch_add(1, Ordering::Release);
        self.ended.wake_all();
    }

    pub(super) fn enter(&self) {
        self.count.fetch_add(1, Ordering::AcqRel);
    }

    pub(super) fn leave(&self) {
        self.count.fetch_sub(1, Ordering::AcqRel);
        self.announce();
    }
}
