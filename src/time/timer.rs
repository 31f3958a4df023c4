//! Timer channels that fire once.

use super::Instant;
use super::period::period_nanos;
use crate::error::Result;
use luna_channels::{Due, Stamp, When};
use luna_core::current;
use luna_platform::clock::Clock;
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

/// A timer channel: it ticks each `period`, the first time a period from now; where that is another
/// clock than its process', as where a system on a [virtual clock](crate::System::virtual_clock) is
/// described, from when it is first waited for.
///
/// For a process that does other things too: its ticks are guards of alternatives beside its
/// channels. A loop that does nothing else between its cycles has more of
/// [`periodic`](crate::periodic): statistics and a choice of what to do about late cycles.
///
/// Slots are absolute, so a tick that is served late shifts none. A slot can be served while it
/// lasts, that is until the next one comes; one that has passed whole is missed, and counted.
/// Real-time path: yes; O(1), no allocation.
///
/// # Errors
///
/// [`SetupError::ZeroPeriod`](crate::error::SetupError::ZeroPeriod) and
/// [`SetupError::PeriodTooLong`](crate::error::SetupError::PeriodTooLong), of more than 292 years.
///
/// ```
/// use luna::prelude::*;
/// use std::time::Duration;
///
/// luna::run(async {
///     let (_stop, stopped) = luna::channel::<()>();
///     let mut blink = luna::ticks(Duration::from_millis(1))?;
///     for _ in 0..3 {
///         luna::alt! {
///             tick = blink.tick() => assert!(luna::now() >= tick.slot),
///             _ = stopped.recv() => break,
///         }
///     }
///     Ok(())
/// })?;
/// # Ok::<(), luna::Error>(())
/// ```
pub fn ticks(period: Duration) -> Result<Ticks> {
    let period = period_nanos("ticks", period)?;
    Ok(Ticks {
        period,
        first: super::now().plus_nanos(period),
        number: 0,
        chosen: Stamp::new(),
        clock: Some(clock_here()),
    })
}

/// A timer channel that ticks: see [`ticks`].
#[derive(Debug)]
pub struct Ticks {
    period: u64,
    /// When slot 1 begins.
    first: Instant,
    /// The slot that was served last, or 0.
    number: u64,
    chosen: Stamp,
    /// The clock by which the first slot was set; none if it was given.
    clock: Option<usize>,
}

/// One tick: what [`Ticks::tick`] gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Tick {
    /// The slot's number, from 1.
    pub number: u64,
    /// When the slot began.
    pub slot: Instant,
    /// From then until it was served: less than a period.
    pub lateness: Duration,
    /// The slots that were missed since the tick before.
    pub missed: u64,
}

/// The clock that the process goes by. One that is recorded goes by its recording, and by no clock
/// of the process that described the system.
fn clock_here() -> usize {
    match current::has_replay_log() {
        true => usize::MAX,
        false => Clock::number_here(),
    }
}

impl Ticks {
    /// Ticks for the first time at `first`, and each period from then on. Counts anew.
    ///
    /// ```
    /// use std::time::Duration;
    /// let first = luna::now() + Duration::from_secs(5);
    /// let ticks = luna::ticks(Duration::from_secs(1))?.starting_at(first);
    /// assert_eq!(ticks.next_slot(), first);
    /// # Ok::<(), luna::Error>(())
    /// ```
    #[must_use]
    pub fn starting_at(mut self, first: Instant) -> Self {
        self.first = first;
        self.number = 0;
        self.clock = None;
        self
    }

    /// How far its slots are apart.
    pub fn period(&self) -> Duration {
        Duration::from_nanos(self.period)
    }

    /// When the next slot begins that has not been served; in the past if it is overdue.
    pub fn next_slot(&self) -> Instant {
        self.slot_after(self.number)
    }

    /// Waits for the next tick; one that is due is given at once. Alone, or as a guard of an
    /// alternative.
    ///
    /// Cancel-safe: a tick that was not chosen stays due while its slot lasts. Real-time path: yes;
    /// O(log n) for n delays of this thread, no allocation.
    ///
    /// ```
    /// use std::time::Duration;
    /// luna::run(async {
    ///     let mut ticks = luna::ticks(Duration::from_millis(1))?;
    ///     let first = ticks.tick().await;
    ///     let second = ticks.tick().await;
    ///     assert_eq!(second.number, first.number + second.missed + 1);
    ///     assert!(second.lateness < ticks.period());
    ///     Ok(())
    /// })?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    #[doc(alias = "next")]
    #[track_caller]
    pub fn tick(&mut self) -> When<NextTick<'_>> {
        let here = clock_here();
        if self.clock.is_some_and(|clock| clock != here) {
            // Made where the system was described, say, on a clock that has nothing to do with the
            // system's.
            self.first = super::now().plus_nanos(self.period);
            self.number = 0;
            self.clock = Some(here);
        }
        When::new(NextTick(self))
    }

    /// When the slot after this one begins.
    fn slot_after(&self, number: u64) -> Instant {
        self.first.plus_nanos(self.period.saturating_mul(number))
    }

    /// Serves the slot that lasts at `now`.
    fn serve(&mut self, now: Instant) -> Tick {
        let before = self.number;
        let passed = (now.nanos_since(self.first) / self.period).max(before);
        self.number = passed.saturating_add(1);
        let slot = self.slot_after(passed);
        Tick {
            number: self.number,
            slot,
            lateness: now - slot,
            missed: passed - before,
        }
    }
}

/// What [`Ticks::tick`] waits for.
#[derive(Debug)]
pub struct NextTick<'a>(&'a mut Ticks);

impl Due for NextTick<'_> {
    type Output = Tick;

    fn due_at(&self, _: Instant) -> Instant {
        self.0.next_slot()
    }

    fn stamp(&self) -> Option<&Stamp> {
        Some(&self.0.chosen)
    }

    fn serve(&mut self, now: Instant) -> Tick {
        self.0.serve(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(nanos: u64) -> Instant {
        Instant::from_nanos(nanos)
    }

    fn ticks() -> Ticks {
        super::ticks(Duration::from_nanos(10))
            .unwrap()
            .starting_at(at(110))
    }

    #[test]
    fn slots_are_absolute_and_missed_ones_counted() {
        let mut ticks = ticks();
        let mut served = |now: u64| {
            let tick = ticks.serve(at(now));
            let lateness = tick.lateness.as_nanos();
            (tick.number, tick.slot.as_nanos(), lateness, tick.missed)
        };
        assert_eq!(served(110), (1, 110, 0, 0));
        // Late within its slot: the next one comes when it would have.
        assert_eq!(served(129), (2, 120, 9, 0));
        assert_eq!(served(130), (3, 130, 0, 0));
        // 140, 150 and 160 have passed whole.
        assert_eq!(served(175), (7, 170, 5, 3));
        assert_eq!(served(180), (8, 180, 0, 0));
    }

    #[test]
    fn a_tick_is_due_from_its_slot_on() {
        let mut ticks = ticks();
        assert_eq!(ticks.next_slot(), at(110));
        ticks.serve(at(135));
        assert_eq!(ticks.next_slot(), at(140));
        assert_eq!(NextTick(&mut ticks).due_at(at(1000)), at(140));
    }

    #[test]
    fn a_start_nearer_to_the_clocks_zero_than_a_period() {
        let mut ticks = super::ticks(Duration::from_secs(1))
            .unwrap()
            .starting_at(at(5));
        assert_eq!(ticks.next_slot(), at(5));
        assert_eq!(ticks.serve(at(6)).number, 1);
        assert_eq!(ticks.next_slot(), at(1_000_000_005));
    }

    #[test]
    fn periods_that_are_none() {
        let zero = super::ticks(Duration::ZERO).unwrap_err();
        assert!(zero.to_string().contains("period of 0"), "{zero}");
        let endless = super::ticks(Duration::MAX).unwrap_err();
        assert!(endless.to_string().contains("292 years"), "{endless}");
    }
}
