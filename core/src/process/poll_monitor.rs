//! The monitor of each poll of a process: for budgets. Processes without one pay nothing.

use alloc::sync::Arc;
use core::any::Any;
use core::cell::RefCell;
use core::fmt;
use luna_platform::clock::Instant;

/// Looks at each poll of one process: see
/// [`ProcessSpec::monitored`](super::ProcessSpec::monitored).
///
/// Its methods run on the process' thread, on the real-time path: no allocation, bounded time.
pub trait PollMonitor: Any + Send + Sync {
    /// A poll begins.
    fn poll_begins(&self, now: Instant);

    /// The poll that began at `began` has ended. The verdict decides what becomes of the process.
    fn poll_ends(&self, began: Instant, now: Instant) -> Verdict;
}

/// What becomes of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It goes on.
    GoOn,
    /// It is ended, unless it has just ended by itself: its body is dropped where it waits, and the
    /// channel ends in it poison their channels.
    Poison,
}

luna_platform::local! {
    /// The monitor of the process with the poll that is under way.
    static MONITOR: RefCell<Option<Arc<dyn PollMonitor>>> = const { RefCell::new(None) };
}

/// Makes the thread's room for it, before the real-time path begins: the first touch registers a
/// destructor, which may allocate.
pub(crate) fn prepare() {
    MONITOR.with(|_| {});
}

/// The poll_monitor of the process that is being polled on this thread, if it has one. Real-time
/// path: yes; O(1), no system call.
pub fn poll_monitor() -> Option<Arc<dyn PollMonitor>> {
    MONITOR.with(|poll_monitor| poll_monitor.borrow().clone())
}

/// Whether the process that is being polled on this thread has a monitor.
pub(crate) fn is_monitored() -> bool {
    MONITOR.with_borrow(Option::is_some)
}

/// Makes it the one that [`poll_monitor`] gives. No process is polled within another's poll, so
/// there is none to be restored.
pub(super) fn set(now: Option<Arc<dyn PollMonitor>>) {
    MONITOR.set(now);
}

impl fmt::Debug for dyn PollMonitor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PollMonitor").finish_non_exhaustive()
    }
}
