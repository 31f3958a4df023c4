//! What the user has of the manager: callbacks.

use super::callbacks::Wish;
use super::{Firing, Manager};
use crate::error::Result;
use crate::time::period::{period_nanos, phase_nanos};
use luna_platform::clock::Instant;
use std::sync::Arc;
use std::time::Duration;

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
