//! A loop's place with the manager.

use super::Manager;
use luna_core::timer_queue::{Sleep, TimerQueue};
use luna_executors::UnderWay;
use luna_platform::clock::Instant;
use luna_platform::sync::Arc;

/// Where a loop waits for its slots.
pub(crate) struct TimerSlot {
    queue: Arc<TimerQueue>,
    /// Of its period's counters.
    number: u32,
}

impl TimerSlot {
    /// For a loop of a period; none if the manager keeps no time.
    pub(crate) fn new(manager: &Manager, period: u64) -> Option<Self> {
        let engine = manager.engine.get()?;
        Some(Self {
            queue: engine.queue.clone(),
            number: engine.ticks.number_of(period),
        })
    }

    /// Waits until the manager wakes the loop at `at`; returns whether it did: if not, the manager
    /// has ended.
    ///
    /// Real-time path: yes; O(log n) for n waits, no allocation, at most one system call.
    /// Cancel-safe.
    pub(crate) async fn wait(&self, at: Instant) -> bool {
        // The thread sleeps without a deadline of its own, and is woken all the same: so this is no
        // deadlock.
        let _under_way = UnderWay::begin();
        Sleep::by(&self.queue, self.number, at).await;
        !self.queue.is_closed()
    }
}
