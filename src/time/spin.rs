//! The guard spin: waking early, and waiting out the rest on the clock.

use super::Instant;

/// The longest guard, as a part of the period: what is spun away stays below one processor's sixteenth.
pub(super) const LONGEST_PART: u64 = 16;

/// Waits on the clock for `slot`, and gives the time that it read last, which is not before it.
///
/// Each turn goes through the executor: whoever is ready at the process' level or above, from its own queue, its timers or from outside, runs first. A process of a
/// lower level is not started, since it would hold the loop up by its whole poll. So the executor is kept from those for the guard at most.
pub(super) async fn until(slot: Instant) -> Instant {
    loop {
        let now = Instant::now();
        if now >= slot {
            return now;
        }
        luna_executors::yield_now().await;
    }
}
