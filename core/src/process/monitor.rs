//! The monitor of each poll of a process: for budgets. Processes without one pay nothing.

use super::{Notice, Process};
use crate::replay_log::LogInstaller;
use alloc::sync::Arc;
use core::any::Any;
use core::cell::RefCell;
use core::fmt;
use luna_platform::clock::Instant;
use luna_platform::sync::plain::{AtomicU64, Ordering};

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
fn set(now: Option<Arc<dyn PollMonitor>>) {
    MONITOR.set(now);
}

/// What is done around each poll of a process with timed polls, or with a replay log.
pub(super) struct Timing {
    pub(super) poll_monitor: Option<Arc<dyn PollMonitor>>,
    pub(super) log_installer: Option<Arc<dyn LogInstaller>>,
    /// The polls are timed also without a monitor.
    pub(super) asked: bool,
    /// Written by the process' thread alone, as the next field.
    longest_poll: AtomicU64,
    /// When the poll began that is under way and not [ended](Process::end_poll) yet, else never.
    began: AtomicU64,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            poll_monitor: None,
            log_installer: None,
            asked: false,
            longest_poll: AtomicU64::new(0),
            began: AtomicU64::new(Instant::NEVER.as_nanos()),
        }
    }
}

luna_platform::debug_fields!(Timing, |timing| asked: timing.asked);

impl Process {
    /// There is one if its polls are timed.
    fn timed(&self) -> Option<&Timing> {
        let timing = self.record.timing.as_deref()?;
        (timing.asked || timing.poll_monitor.is_some()).then_some(timing)
    }

    /// The longest of its polls in nanoseconds, if they are timed.
    pub(super) fn longest_poll(&self) -> Option<u64> {
        Some(self.timed()?.longest_poll.load(Ordering::Relaxed))
    }

    /// Installs its replay log around each poll.
    pub(super) fn log_installer(&self) -> Option<&Arc<dyn LogInstaller>> {
        self.record.timing.as_ref()?.log_installer.as_ref()
    }

    /// Whether it is to be ended.
    #[inline]
    pub(super) fn is_cancelled(&self) -> bool {
        self.has_notice(Notice::CANCELLED)
    }

    /// Whether the channel ends that go with its body are to poison their channels.
    pub(super) fn is_poisoned(&self) -> bool {
        self.has_notice(Notice::POISONED)
    }

    /// Begins a poll, if polls are timed.
    pub(super) fn begin_poll(&self) {
        let Some(timing) = self.timed() else {
            return;
        };
        let began = Instant::now();
        if let Some(poll_monitor) = &timing.poll_monitor {
            // It may panic, so the poll monitor is not installed while it runs.
            poll_monitor.poll_begins(began);
            set(Some(poll_monitor.clone()));
        }
        timing.began.store(began.as_nanos(), Ordering::Relaxed);
    }

    /// Ends a timed poll, once. If the poll monitor wants the process ended, it counts as cancelled
    /// from here on. The poll monitor may panic.
    pub(super) fn end_poll(&self) {
        let Some(timing) = self.timed() else {
            return;
        };
        let never = Instant::NEVER.as_nanos();
        let began = Instant::from_nanos(timing.began.load(Ordering::Relaxed));
        if began == Instant::NEVER {
            return;
        }
        timing.began.store(never, Ordering::Relaxed);
        let now = Instant::now();
        timing
            .longest_poll
            .fetch_max(now.nanos_since(began), Ordering::Relaxed);
        if let Some(poll_monitor) = &timing.poll_monitor {
            // The process has another reference, so nothing is freed here.
            set(None);
            if poll_monitor.poll_ends(began, now) == Verdict::Poison {
                self.notify(Notice::CANCELLED | Notice::POISONED);
            }
        }
    }
}

impl fmt::Debug for dyn PollMonitor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PollMonitor").finish_non_exhaustive()
    }
}
