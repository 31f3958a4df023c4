//! Whether an operation spins for its partner for a bounded time before its process waits.

pub use luna_platform::spin::*;

#[cfg(not(loom))]
use crate::current;

/// At least as long as [`look`] takes.
#[cfg(not(loom))]
const LOOKS_TAKE: std::time::Duration = std::time::Duration::from_micros(4);

/// Whether an operation that has to wait may spin for its partner first.
///
/// Its thread may spin, its process has no other branch and has not used up its turn, and nothing
/// else is ready there. Real-time path: yes; one load where the thread may not spin, else a few,
/// and a clock read if it has a deadline.
///
/// ```
/// assert!(!luna_core::spin::may_look()); // a plain thread may not
/// ```
#[cfg(not(loom))]
#[inline]
pub fn may_look() -> bool {
    // Counted, so that the executor gets to its files. A process that may not spin waits: if it
    // were readied again instead, it would not be visible that it waits.
    is_allowed() && has_nothing_else() && current::count_operation()
}

#[cfg(not(loom))]
fn has_nothing_else() -> bool {
    !current::in_branch()
        && !current::has_replay_log()
        && current::ready_levels() == 0
        && current::has_no_deadline_within(LOOKS_TAKE)
}

/// In a model the thread alone decides.
#[cfg(loom)]
pub fn may_look() -> bool {
    is_allowed()
}
