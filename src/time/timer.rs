//! Timer channels that fire once.

use super::Instant;
use luna_channels::{Due, When};
use std::time::Duration;

/// A timer that fires once each time it is set: a timeout that lives longer than one wait.
///
/// It belongs to one process, which sets and cancels it between its waits, and waits for
/// [`expired`](Self::expired), mostly as a guard. Unlike [`after`](crate::after) in an alternative,
/// it goes on while other guards are chosen. All of it may be used on the real-time path; nothing
/// is allocated.
///
/// ```
/// use luna::Timer;
/// use luna::prelude::*;
/// use std::time::Duration;
///
/// luna::run(async {
///     let (_commands, commanded) = luna::channel::<f64>();
///     let mut silence = Timer::new();
///     silence.set(Duration::from_millis(1));
///     let speed = luna::alt! {
///         command = commanded.recv() => command?,
///         _ = silence.expired() => 0.0, // for too long: stop
///     };
///     assert_eq!(speed, 0.0);
///     assert!(!silence.is_set());
///     Ok(())
/// })?;
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug)]
pub struct Timer {
    /// `NEVER` unless it is set.
    deadline: Instant,
}

impl Timer {
    /// A timer that is not set.
    pub const fn new() -> Timer {
        Timer {
            deadline: Instant::NEVER,
        }
    }

    /// Fires `delay` from now; no more at the time that it was set to before. O(1).
    pub fn set(&mut self, delay: Duration) {
        self.set_at(super::now() + delay);
    }

    /// Fires at `deadline`, which may have passed; no more at the time that it was set to before.
    /// O(1).
    pub fn set_at(&mut self, deadline: Instant) {
        self.deadline = deadline;
    }

    /// Does not fire any more; returns whether it was set. O(1).
    ///
    /// ```
    /// let mut timer = luna::Timer::new();
    /// timer.set(std::time::Duration::from_secs(1));
    /// assert!(timer.cancel());
    /// assert!(!timer.cancel());
    /// ```
    pub fn cancel(&mut self) -> bool {
        std::mem::replace(&mut self.deadline, Instant::NEVER) != Instant::NEVER
    }

    /// Whether it is set and has not fired.
    pub fn is_set(&self) -> bool {
        self.deadline != Instant::NEVER
    }

    /// When it fires, if it is set.
    pub fn deadline(&self) -> Option<Instant> {
        self.is_set().then_some(self.deadline)
    }

    /// Waits until it fires, and returns its deadline; it is then no longer set. If it is not set,
    /// it waits for ever. Alone, or as a guard of an alternative.
    ///
    /// Cancel-safe: if it is not chosen it stays set. Real-time path: yes; O(log n) for n delays of
    /// this thread, no allocation.
    ///
    /// ```
    /// luna::run(async {
    ///     let mut timer = luna::Timer::new();
    ///     let deadline = luna::now() + std::time::Duration::from_millis(1);
    ///     timer.set_at(deadline);
    ///     assert_eq!(timer.expired().await, deadline);
    ///     Ok(())
    /// })?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    #[track_caller]
    pub fn expired(&mut self) -> When<Expiry<'_>> {
        When::new(Expiry(self))
    }
}

impl Default for Timer {
    fn default() -> Self {
        Self::new()
    }
}

/// What [`Timer::expired`] waits for.
#[derive(Debug)]
pub struct Expiry<'a>(&'a mut Timer);

impl Due for Expiry<'_> {
    type Output = Instant;

    fn due_at(&self, _: Instant) -> Instant {
        self.0.deadline
    }

    fn serve(&mut self, _: Instant) -> Instant {
        std::mem::replace(&mut self.0.deadline, Instant::NEVER)
    }
}
