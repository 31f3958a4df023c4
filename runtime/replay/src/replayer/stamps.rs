//! When on the replay's clock an event happens: by its stamp.

use luna_platform::clock::{Instant, VirtualClock};

/// After all stamps: a process that has not ended by then waits for something that was not
/// recorded.
pub(super) const END: u64 = 1 << 61;

/// After all stamps, and before the end: what was under way when its process was cut.
pub(super) const LATE: u64 = 1 << 60;

/// When what bears this stamp happens.
pub(super) fn at(stamp: u64) -> Instant {
    VirtualClock::ORIGIN + std::time::Duration::from_nanos(stamp.min(END) * 2)
}

/// When what bears this stamp happens if it does not wait: its partner, which may, is there by
/// then.
pub(super) fn after(stamp: u64) -> Instant {
    at(stamp) + std::time::Duration::from_nanos(1)
}
