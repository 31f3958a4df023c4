//! Whether an operation spins for its partner for a bounded time before its process waits.

pub use luna_platform::spin::*;

use crate::current;

/// At least as long as [`look`] takes.
const LOOKS_TAKE: core::time::Duration = core::time::Duration::from_micros(4);

/// Whether an operation that has to wait may spin for its partner first.
///
/// It may if: its thread may spin; its process polls no branch, has no replay log and has
/// operations left in this turn; no process is ready on the thread; and no deadline comes while it
/// looks. Real-time path: yes; one load where the thread may not spin, else a few, and a clock read
/// if it has a deadline.
///
/// ```
/// assert!(!luna_core::spin::may_look()); // a plain thread may not
/// ```
#[inline]
pub fn may_look() -> bool {
    // Spinning counts as an operation. A process that spins in each of its operations thus ends its
    // poll after a bounded number of them, and the executor looks at its files. With no operations
    // left, the process waits. It is not readied again, since other threads could then not see that
    // it waits.
    // In a model the thread alone decides.
    is_allowed() && (cfg!(loom) || has_nothing_else() && current::count_operation())
}

fn has_nothing_else() -> bool {
    !current::in_branch()
        && !current::has_replay_log()
        && current::ready_levels() == 0
        && current::has_no_deadline_within(LOOKS_TAKE)
}
