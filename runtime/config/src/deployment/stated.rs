//! What a file states, with where each value stands.

use super::budgets::OnOverrun;
use luna_platform::thread::Policy;
use std::ops::Range;
use std::sync::atomic::AtomicU64;
use std::time::Duration;

/// A value, and its place in the file.
pub(super) struct At<T> {
    pub(super) value: T,
    pub(super) span: Range<usize>,
}

#[derive(Default)]
pub(super) struct Stated {
    pub(super) strict: Option<At<bool>>,
    pub(super) lock_memory: Option<At<bool>>,
    pub(super) threads: Vec<Named<Thread>>,
    pub(super) processes: Vec<Named<Process>>,
    pub(super) loops: Vec<Named<Loop>>,
}

/// What is stated of something with this name.
pub(super) type Named<T> = (At<String>, T);

/// Of an executor or a thread.
#[derive(Default)]
pub(super) struct Thread {
    /// Or none, which is any.
    pub(super) core: Option<At<Option<usize>>>,
    pub(super) policy: Option<At<Policy>>,
    pub(super) spin_before_sleep: Option<At<Duration>>,
    pub(super) stack_size: Option<At<usize>>,
}

#[derive(Default)]
pub(super) struct Process {
    pub(super) on: Option<At<String>>,
    pub(super) priority: Option<At<u8>>,
    pub(super) poll_budget: Option<At<Duration>>,
    pub(super) cycle_budget: Option<At<Duration>>,
    pub(super) on_overrun: Option<At<OnOverrun>>,
}

pub(super) struct Loop {
    pub(super) period: At<Duration>,
    /// The period that the program stated, in nanoseconds; 0 until such a loop begins.
    pub(super) program: AtomicU64,
}
