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
mod thread;
use crate::error::{Result, SetupError};
use crate::time::period::{period_nanos, phase_nanos};
pub use callbacks::Firing;
use callbacks::{Callbacks, Wish};
use luna_core::UnderWay;
use luna_core::timer_queue::{DeadlineListener, Sleep, TimerQueue};
use luna_platform::clock::Instant;
use luna_platform::deadline_sleep::DeadlineSleep;
use luna_platform::sync::Arc as QueueArc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;
pub(crate) use thread::ManagerThread;
pub use thread::{CallbackReport, TimersReport};

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

/// The timer manager of a system, for callbacks: from
/// [`System::timer_manager`](crate::System::timer_manager). Cloning it is cheap; processes can keep
/// one.
#[derive(Clone)]
pub struct TimerManager {
    manager: Arc<Manager>,
}

impl TimerManager {
    pub(crate) fn new(manager: Arc<Manager>) -> Self {
        Self { manager }
    }

    /// A function that the manager's thread calls when it is set: see [`TimerCallback`]. Not for
    /// the real-time path: it allocates.
    ///
    /// # Errors
    ///
    /// [`SetupError::CallbackOnVirtualClock`](crate::error::SetupError::CallbackOnVirtualClock) in
    /// a system that runs on a virtual clock; one that has a callback before does not start there.
    ///
    /// [`SetupError::TooManyTimers`](crate::error::SetupError::TooManyTimers): the system runs, and
    /// the room that was set aside before the start is taken
    /// ([`System::max_timers`](crate::System::max_timers)).
    pub fn callback(
        &self,
        name: &str,
        function: impl FnMut(Firing) + Send + 'static,
    ) -> Result<TimerCallback> {
        let number = (self.manager.callbacks).add(name.to_owned(), Box::new(function))?;
        Ok(TimerCallback {
            manager: self.manager.clone(),
            number,
        })
    }
}

/// A function that the timer manager calls on its own thread: each slot of a period, or once at an
/// instant.
///
/// That thread is above all processes, so **the function must be short**: while it runs, no loop of
/// the system is woken. It must not wait, nor allocate. What takes longer than 100 µs is counted,
/// and the longest time stands in the [report](crate::report::TimersReport). It is called after the
/// loops of the same tick were woken; several that are due together in the order of their
/// deadlines.
///
/// A panic in it is an emergency like one in a process: the functions of
/// [`on_emergency`](crate::System::on_emergency) run, and the system ends with
/// [`Error::Callback`](crate::Error::Callback). Callbacks do not keep a system running, and end
/// with it: their functions are dropped then, and setting one later does nothing.
///
/// Setting and cancelling are for any thread, on the real-time path too: O(log n) for n callbacks
/// and loops, no allocation, at most one system call. One may set and cancel itself. Dropping the
/// handle ends the callback, off the path, since it frees the function.
///
/// ```
/// use luna::prelude::*;
/// use luna::time::Timers;
/// use std::time::Duration;
///
/// let mut system = System::new("sampler");
/// system.timers(Timers::Manager);
/// let timers = system.timer_manager()?;
/// let (sample, samples) = luna::buffered(Buffer::fifo(8));
/// let sampler = timers.callback("sample", move |firing| {
///     let _ = sample.try_send(firing.number); // never waits
/// })?;
/// sampler.every(Duration::from_millis(1), Duration::ZERO)?;
/// let main = system.executor("main").build()?;
/// main.process("filter").spawn(async move {
///     let first = samples.recv().await?;
///     assert!(samples.recv().await? > first);
///     Ok(())
/// })?;
/// let report = system.run()?;
/// assert!(report.timers.unwrap().callbacks[0].calls >= 2);
/// # Ok::<(), luna::Error>(())
/// ```
pub struct TimerCallback {
    manager: Arc<Manager>,
    number: usize,
}

impl TimerCallback {
    /// Calls it at each slot of the common grid of `period`, `phase` behind it, as
    /// [`Periodic::phase`](crate::Periodic::phase) does for loops; no more at what it was set to
    /// before.
    ///
    /// A slot can be served while it lasts; those that pass whole are missed, and counted. Before
    /// the system runs it counts from the start.
    ///
    /// # Errors
    ///
    /// [`SetupError::ZeroPeriod`](crate::error::SetupError::ZeroPeriod),
    /// [`SetupError::PeriodTooLong`](crate::error::SetupError::PeriodTooLong) (of more than 292
    /// years) and [`SetupError::PhaseTooLong`](crate::error::SetupError::PhaseTooLong) (of a period
    /// or more).
    pub fn every(&self, period: Duration, phase: Duration) -> Result<()> {
        let name = "timer callback";
        let (nanos, behind) = (
            period_nanos(name, period)?,
            phase_nanos(name, phase, period)?,
        );
        self.set(Wish::Every {
            period: nanos,
            phase: behind,
        });
        Ok(())
    }

    /// Calls it once, at `deadline`, which may have passed; no more at what it was set to before.
    ///
    /// For an instant that has passed it is called at once, but not before it has rested after its
    /// last call for as long as that took, and for 100 µs at least: one that sets itself to the
    /// past in each call takes half of a core at most, and does not keep other callbacks from being
    /// called. Each such call counts as late ([`Firing::lateness`]).
    pub fn at(&self, deadline: Instant) {
        self.set(Wish::At(deadline));
    }

    /// Calls it once, `delay` from now; no more at what it was set to before. After no delay, as
    /// [`at`](Self::at) an instant that has passed.
    pub fn after(&self, delay: Duration) {
        self.at(Instant::now() + delay);
    }

    /// Calls it no more; returns whether it was set. A call that has begun goes on, and may end
    /// after this returns.
    ///
    /// ```
    /// # let mut system = luna::System::new("machine");
    /// system.timers(luna::time::Timers::Manager);
    /// let late = system.timer_manager()?.callback("late", |_| ())?;
    /// late.after(std::time::Duration::from_secs(1));
    /// assert!(late.is_set());
    /// assert!(late.cancel());
    /// assert!(!late.cancel());
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn cancel(&self) -> bool {
        self.manager.callbacks.cancel(self.number)
    }

    /// Whether it is set: to a period, or to an instant at which it was not called yet.
    pub fn is_set(&self) -> bool {
        self.manager.callbacks.is_set(self.number)
    }

    fn set(&self, wish: Wish) {
        let engine = self.manager.engine.get();
        self.manager.callbacks.set(self.number, wish, engine);
    }
}

impl Drop for TimerCallback {
    fn drop(&mut self) {
        self.manager.callbacks.release(self.number);
    }
}

luna_platform::debug_fields!(TimerManager);

luna_platform::debug_fields!(TimerCallback, |callback| number: callback.number);
