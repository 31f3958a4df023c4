//! What the two sides and their watch know of each other: counters.

use crate::kernel;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU8, AtomicU64, AtomicUsize, Ordering};

/// What the high side does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum How {
    /// An operation that never waits for a partner.
    Try,
    /// One that does.
    Await,
    /// The same, blocking the thread.
    Block,
}

impl How {
    fn of(number: u8) -> How {
        [How::Try, How::Await, How::Block][usize::from(number) % 3]
    }
}

/// What the low side does.
pub(crate) mod low {
    pub(crate) const BETWEEN: u8 = 0;
    pub(crate) const OPERATES: u8 = 1;
    pub(crate) const WAITS: u8 = 2;
}

/// Shared by all threads of a run.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    /// How many scenes the high side is through with.
    pub(crate) scene: AtomicUsize,
    /// The run is over, whatever the scene.
    pub(crate) over: AtomicBool,
    /// The number and kind of the operation that the high side is in; 0 between two.
    operation: AtomicU64,
    /// How many operations the high side has done, and how many of them began in the middle of one
    /// of the low side.
    pub(crate) high: AtomicU64,
    pub(crate) high_in_low: AtomicU64,
    /// How many operations the low side has done, and what it does.
    pub(crate) low: AtomicU64,
    pub(crate) low_state: AtomicU8,
    /// How many steps the burner has done, and in how many nanoseconds of processor time.
    pub(crate) burnt: AtomicU64,
    pub(crate) burnt_for: AtomicU64,
    /// The greatest number of such steps in one operation of the high side.
    pub(crate) most_burnt: AtomicU64,
    /// How many of them had more of them than a switch takes.
    pub(crate) inverted: AtomicU64,
    /// How many operations do not count, since the machine kept the high side off its core.
    pub(crate) excused: AtomicU64,
    /// The threads; 0 where there is none.
    pub(crate) high_thread: AtomicI32,
    pub(crate) low_thread: AtomicI32,
    pub(crate) burner_thread: AtomicI32,
    pub(crate) violations: Mutex<Vec<String>>,
}

impl Shared {
    pub(crate) fn begin(&self, number: u64, how: How) {
        self.operation
            .store(number << 8 | how as u64, Ordering::SeqCst);
    }

    pub(crate) fn end(&self) {
        self.operation.store(0, Ordering::SeqCst);
    }

    /// The number of the operation that the high side is in, and its kind.
    pub(crate) fn operation(&self) -> Option<(u64, How)> {
        match self.operation.load(Ordering::SeqCst) {
            0 => None,
            word => Some((word >> 8, How::of(word as u8))),
        }
    }

    pub(crate) fn set_thread(of: &AtomicI32) {
        of.store(kernel::thread_id(), Ordering::Relaxed);
    }
}
