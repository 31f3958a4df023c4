//! What a process, an executor and a priority are known by.

use core::cell::Cell;
use core::fmt;
use core::num::{NonZeroU32, NonZeroU64};
use luna_platform::sync::plain::{AtomicU32, AtomicU64, Ordering};

/// A process id, unique within this program's run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ProcessId(NonZeroU32);

impl ProcessId {
    /// A new id; on one thread mostly the next one. Wraps after 2^32 processes.
    pub fn new() -> Self {
        /// Ids that a thread takes at once, so that it seldom touches the shared counter.
        const BLOCK: u32 = 64;
        static NEXT: AtomicU32 = AtomicU32::new(1);
        luna_platform::local! {
            /// The next id of this thread's block, and the number of ids left.
            static OWN: Cell<(u32, u32)> = const { Cell::new((0, 0)) };
        }
        let (next, left) = match OWN.get() {
            (_, 0) => (NEXT.fetch_add(BLOCK, Ordering::Relaxed), BLOCK),
            own => own,
        };
        OWN.set((next.wrapping_add(1), left - 1));
        Self(NonZeroU32::new(next).unwrap_or(NonZeroU32::MIN))
    }

    /// The process of this number; 0 is none.
    pub fn from_number(number: u32) -> Option<Self> {
        NonZeroU32::new(number).map(Self)
    }

    /// The number itself.
    pub fn get(self) -> u32 {
        self.0.get()
    }
}

impl fmt::Display for ProcessId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// The user of a channel, or of anything else to wait for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum User {
    /// A thread that runs no LUNA process: a plain one, or another runtime's.
    Outside,
    /// This process.
    Process(ProcessId),
}

/// Id of an executor: a thread that runs processes, or that of an OS-thread process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ExecutorId(NonZeroU64);

impl ExecutorId {
    /// A new id.
    pub fn new() -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        // 64 bits do not wrap. Executor ids must differ: counting without atomics relies on it.
        Self(NonZeroU64::new(number).unwrap_or(NonZeroU64::MIN))
    }

    #[inline]
    pub(crate) fn number(self) -> u64 {
        self.0.get()
    }
}

/// The priority of a process: that of its OS thread first, then its level on the executor. Greater
/// is more urgent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Priority {
    /// 0 for threads without a real-time policy, else their SCHED_FIFO or SCHED_RR priority; 100
    /// under SCHED_DEADLINE.
    pub thread: u8,
    /// The level within the executor, 0 to 31.
    pub level: u8,
}

/// Where in the queue of its level a process is put.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QueueEnd {
    /// Before the others: it only yielded to more urgent ones.
    Front,
    /// Behind the others.
    Back,
}
