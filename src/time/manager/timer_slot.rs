//! A loop's place with the manager.

use super::Manager;
use super::timer_groups::Place;
use luna_core::tick_list::Woken;
use luna_executors::UnderWay;
use luna_platform::clock::Instant;
use std::sync::Arc;

/// Where a loop waits for its slots. Given up when it is dropped.
pub(crate) struct TimerSlot {
    manager: Arc<Manager>,
    place: Place,
}

impl TimerSlot {
    pub(crate) fn new(manager: Arc<Manager>, period: u64) -> Self {
        Self {
            manager,
            place: Place::new(period),
        }
    }

    /// Waits until the manager wakes the loop at `at`, one of its slots; returns whether it did: if
    /// not, there is no room for the loop's period, or the manager has ended.
    ///
    /// Real-time path: yes; O(loops of this group of lower priority), no allocation; at most two
    /// system calls where the place is a new one. Cancel-safe.
    pub(crate) async fn wait(&mut self, at: Instant) -> bool {
        let Some(list) = self.manager.list_for(&mut self.place, at) else {
            return false;
        };
        // The thread sleeps without a deadline of its own, and is woken all the same: so this is no
        // deadlock.
        let _under_way = UnderWay::begin();
        list.wait(at).await == Woken::ByTick
    }

    /// Gives the place up until the next wait.
    pub(crate) fn leave(&mut self) {
        self.manager.vacate(&mut self.place);
    }
}

impl Drop for TimerSlot {
    fn drop(&mut self) {
        self.leave();
    }
}
