//! The clock.

use luna_core::current;
use luna_platform::clock::Instant;

/// The time on the clock of the system. Real-time path: yes; O(1), no system call (24 ns on the
/// reference machine).
///
/// ```
/// let start = luna::now();
/// assert!(luna::now() >= start);
/// ```
#[inline]
pub fn now() -> Instant {
    if current::has_replay_log() {
        return luna_core::replay_log::now();
    }
    Instant::now()
}
