//! The timer manager: one thread above all others that sleeps until the next deadline, and wakes
//! the loops that are due in order of priority.
//!
//! ```text
//!   loop, in `next`                        manager's thread
//!   1 arms its slot in the manager's       a sleeps until the first slot of the queue
//!     queue, and wakes the manager    ---> b takes off all whose slot has come, under the queue's lock
//!     if that is the first one             c wakes them, most urgent first, without a lock
//!                                          d runs the callbacks that are due
//! ```
//!
//! The queue is [`luna_core::timer_queue`], as executors have it, but any thread arms in it.
//! [`TimerSlot`] is a loop's place, `callbacks` what is called on the thread itself, `thread` the
//! thread's life, `handle` what the user has of it.
//!
//! Locks, in this order: the callbacks', the queue's. No more than O(log of what is
//! armed) is done under one, and no user code runs there.

mod callbacks;
mod handle;
mod report;
mod thread;

pub use callbacks::Firing;
pub use handle::{TimerCallback, TimerManager};
pub use report::{CallbackReport, TimersReport};
pub(crate) use thread::ManagerThread;

use crate::error::SetupError;
use callbacks::Callbacks;
use luna_core::UnderWay;
use luna_core::timer_queue::{DeadlineListener, Sleep, TimerQueue};
use luna_platform::clock::Instant;
use luna_platform::deadline_sleep::DeadlineSleep;
use luna_platform::sync::Arc as QueueArc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// What wakes the loops of a system at their slots. Set by
/// [`System::timers`](crate::System::timers); the loops' code is the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Timers {
    /// Each executor, and each OS-thread process, sleeps until the next deadline of its own: one
    /// wake-up for all loops of an executor, and no thread in between.
    #[default]
    Executor,
    /// The timer manager: a thread of SCHED_FIFO 98, above all processes, that sleeps until the
    /// next slot of a loop and wakes the loops of a slot in order of priority, across executors and
    /// OS threads.
    ///
    /// For systems of several threads with loops that are to begin in order and in phase, for
    /// callbacks ([`TimerManager`]), and for machines with few timers: it takes one. A wake-up
    /// takes one thread switch more than [`Executor`](Self::Executor); `docs/time-sources.md` has
    /// the figures. In a system in which no thread asks for a real-time policy the manager has none
    /// either.
    ///
    /// A loop without a [`phase`](crate::Periodic::phase) begins at the last slot of phase 0 on the
    /// common grid, not when it is made, so that all loops of a period are in phase. Delays,
    /// [`ticks`](crate::ticks()) and [`Timer`](crate::Timer)s take their executor's deadlines.
    Manager,
}

/// The default room for callbacks.
pub(crate) const MAX_CALLBACKS: usize = 64;

/// What loops, callbacks' handles and the thread share.
#[derive(Default)]
pub(crate) struct Manager {
    callbacks: Callbacks,
    /// There from the launch on.
    engine: OnceLock<Engine>,
    /// What the common grids count from, in nanoseconds.
    start: AtomicU64,
}

/// What the thread sleeps for.
struct Engine {
    nap: Arc<Nap>,
    queue: QueueArc<TimerQueue>,
    /// The longest time from a slot until the thread dealt with it, in nanoseconds.
    latest: AtomicU64,
}

/// The sleep of the thread, which any thread may end.
struct Nap(DeadlineSleep);

impl DeadlineListener for Nap {
    fn ask_look(&self) {
        self.ask_look_at(Instant::from_nanos(0));
    }

    fn ask_look_at(&self, deadline: Instant) {
        self.0.wake_by(deadline);
    }
}

impl Engine {
    fn note_lateness(&self, nanos: u64) {
        self.latest.fetch_max(nanos, Ordering::Relaxed);
    }
}

impl Manager {
    /// Makes the queue, and room for `most` callbacks.
    pub(crate) fn prepare(&self, most: usize) {
        let nap = Arc::new(Nap(DeadlineSleep::new()));
        self.callbacks.close_room(most);
        let queue = QueueArc::new(TimerQueue::shared(nap.clone()));
        // It is launched once.
        let _ = self.engine.set(Engine {
            nap,
            queue,
            latest: AtomicU64::new(0),
        });
    }

    /// There is no thread for it, since time is virtual: callbacks are refused.
    pub(crate) fn refuse(&self) -> Result<(), SetupError> {
        self.callbacks.refuse()
    }

    /// The processes start at `start`: callbacks that were started before begin to count.
    pub(crate) fn begin(&self, start: Instant) {
        // A process that is released sees what came before the release.
        self.start.store(start.as_nanos(), Ordering::Relaxed);
        if let Some(engine) = self.engine.get() {
            self.callbacks.begin(start, engine);
        }
    }

    /// The slot of phase 0 on the common grid that lasts at `now`.
    pub(crate) fn slot_before(&self, now: Instant, period: u64) -> Instant {
        let start = Instant::from_nanos(self.start.load(Ordering::Relaxed));
        let since = now.nanos_since(start);
        start.plus_nanos(since - since % period)
    }
}

/// Where a loop waits for its slots.
pub(crate) struct TimerSlot {
    queue: QueueArc<TimerQueue>,
}

impl TimerSlot {
    /// For a loop; none if the manager keeps no time.
    pub(crate) fn new(manager: &Manager) -> Option<Self> {
        let queue = manager.engine.get()?.queue.clone();
        Some(Self { queue })
    }

    /// Waits until the manager wakes the loop at `at`; returns whether it did: if not, the manager
    /// has ended.
    ///
    /// Real-time path: yes; O(log n) for n waits, no allocation, at most one system call.
    /// Cancel-safe.
    pub(crate) async fn wait(&self, at: Instant) -> bool {
        // The thread sleeps without a deadline of its own, and is woken all the same: so this is no
        // deadlock.
        let _under_way = UnderWay::begin();
        Sleep::by(&self.queue, at).await;
        !self.queue.is_closed()
    }
}
