//! The timer manager: one thread above all others that sleeps on one timer of the kernel for each
//! period, and wakes the loops of a tick in order of priority.
//!
//! ```text
//!   loop, in `next`                    manager's thread
//!   1 has a timer slot in a group      a sleeps on the alarm: the timers of all groups
//!     whose ticks come at its slots    b reads the timer: the number of ticks
//!   2 enters the group's list,   --->  c takes off all loops that are due, under the list's lock
//!     or sees that its slot            d wakes them, most urgent first, without a lock
//!     has fired                        e runs the callbacks that are due
//! ```
//!
//! `timer_groups` decides which loops share a timer. `alarm` has the timers, `timer_slot` a loop's
//! place in a group. `callbacks` are called on the thread itself, `heap` has their deadlines.
//! `thread` starts and ends the thread, and `handle` is the user's view of it.
//! [`luna_core::tick_list`] ensures that a tick is never slept through.
//!
//! Locks, in this order: the callbacks', the timer groups', a list's. No more than O(loops of one
//! group, or log of the callbacks) is done under one, and no user code runs there.

mod alarm;
mod callbacks;
mod handle;
mod heap;
mod report;
mod thread;
mod timer_groups;
mod timer_slot;

pub use callbacks::Firing;
pub use handle::{TimerCallback, TimerManager};
pub use report::{CallbackReport, TickReport, TimersReport};
pub(crate) use thread::ManagerThread;
pub(crate) use timer_slot::TimerSlot;

use crate::error::SetupError;
use alarm::Alarm;
use callbacks::Callbacks;
use luna_core::tick_list::TickList;
use luna_platform::clock::Instant;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use timer_groups::{Place, TimerGroups};

/// What wakes the loops of a system at their slots. Set by
/// [`System::timers`](crate::System::timers); the loops' code is the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Timers {
    /// Each executor, and each OS-thread process, sleeps until the next deadline of its own: one
    /// wake-up for all loops of an executor, and no thread in between.
    #[default]
    Executor,
    /// The timer manager: a thread of SCHED_FIFO 98, above all processes, that sleeps on one timer
    /// for each period and wakes the loops of a tick in order of priority, across executors and OS
    /// threads.
    ///
    /// For systems of several threads with loops that are to begin in order and in phase, for
    /// callbacks ([`TimerManager`]), and for machines with few timers. A wake-up takes one thread
    /// switch more than [`Executor`](Self::Executor); `docs/time-sources.md` has the figures. In a
    /// system in which no thread asks for a real-time policy the manager has none either.
    ///
    /// A loop with a multiple of another's period joins the other's ticks, if they are in phase. A
    /// loop without a [`phase`](crate::Periodic::phase) begins at the last slot of phase 0 on the
    /// common grid, not when it is made, so that all loops of a period are in phase. Loops that
    /// leave the common grid ([`correct`](crate::Periodic::correct),
    /// [`Overrun::Rephase`](crate::time::Overrun::Rephase)), and those of a seventeenth period at
    /// once, take their executor's deadlines. So do delays, [`ticks`](crate::ticks()) and
    /// [`Timer`](crate::Timer)s.
    Manager,
}

/// Number of kernel timers for timer groups: the most periods that are no multiples of each other,
/// or phases, at a time.
const BASES: usize = 16;

/// The default room for callbacks.
pub(crate) const MOST_CALLBACKS: usize = 64;

/// What loops, callbacks' handles and the thread share.
pub(crate) struct Manager {
    callbacks: Callbacks,
    /// There from the launch on.
    engine: OnceLock<Engine>,
    /// What the common grids count from, in nanoseconds.
    start: AtomicU64,
}

/// What needs the kernel's timers.
struct Engine {
    alarm: Alarm,
    timer_groups: TimerGroups,
}

impl Manager {
    /// As it is while the system is described.
    pub(crate) fn new() -> Arc<Self> {
        Arc::new(Self {
            callbacks: Callbacks::new(),
            engine: OnceLock::new(),
            start: AtomicU64::new(0),
        })
    }

    /// Makes the kernel's timers, and room for `most` callbacks.
    pub(crate) fn prepare(&self, most: usize) -> Result<(), SetupError> {
        let alarm = Alarm::new(BASES)?;
        self.callbacks.close_room(most);
        let timer_groups = TimerGroups::new(BASES);
        // It is launched once.
        let _ = self.engine.set(Engine {
            alarm,
            timer_groups,
        });
        Ok(())
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

    /// The list of the timer group on which `place` waits for `at`, after it has found its place
    /// anew if that is needed; none if there is no room. O(1); O(timer groups) and a system call
    /// where the place is a new one.
    fn list_for(&self, place: &mut Place, at: Instant) -> Option<&TickList> {
        let engine = self.engine.get()?;
        engine.timer_groups.settle(place, at, &engine.alarm);
        engine.timer_groups.list(place)
    }

    fn vacate(&self, place: &mut Place) {
        if let Some(engine) = self.engine.get() {
            engine.timer_groups.vacate(place, &engine.alarm);
        }
    }
}
