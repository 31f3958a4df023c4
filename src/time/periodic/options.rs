//! What is set for a loop after it was made.

use super::{Overrun, Periodic};
use crate::error::{Result, SetupError};
use crate::time::period::phase_nanos;
use crate::time::spin;
use luna_platform::clock::nanos;
use std::time::Duration;

impl Periodic {
    /// Treats slots that come while the loop is busy by `policy`; the default is
    /// [`Overrun::SkipToGrid`].
    ///
    /// ```
    /// # use std::time::Duration;
    /// # luna::run(async {
    /// let tick = luna::periodic("integrator", Duration::from_millis(1))?;
    /// let tick = tick.overrun(luna::time::Overrun::CatchUp);
    /// # drop(tick); Ok(()) })?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    #[must_use]
    pub fn overrun(mut self, policy: Overrun) -> Self {
        self.overrun = policy;
        self
    }

    /// Ends the process with [`Error::Overrun`](crate::Error::Overrun) when `cycles` cycles in a
    /// row were late, that is when the loop came back after the next slot had begun. A cycle in
    /// time begins the count anew. 0 counts as 1.
    ///
    /// ```
    /// use std::time::Duration;
    /// let outcome = luna::run(async {
    ///     let mut tick = luna::periodic("hog", Duration::from_micros(100))?.limit(3);
    ///     loop {
    ///         tick.next().await;
    ///         let busy = luna::now() + Duration::from_micros(150);
    ///         while luna::now() < busy {}
    ///     }
    ///     #[allow(unreachable_code, reason = "says the type")]
    ///     Ok(())
    /// });
    /// assert!(matches!(outcome, Err(luna::Error::Overrun { consecutive: 3, .. })));
    /// ```
    #[must_use]
    pub fn limit(mut self, cycles: u32) -> Self {
        self.limit = Some(cycles.max(1));
        self
    }

    /// Puts the loop on the grid that all loops of its period have in common, `phase` behind it:
    /// slot `k` begins at the start of the [`System`](crate::System) (or of
    /// [`luna::run`](crate::run)) plus `phase` plus `k` periods, from slot 1 on.
    ///
    /// Loops of one period with different phases thus keep their distance exactly, on whichever
    /// executors they run, and a slot has the same number in all of them. The loop joins at its
    /// first [`next`](Self::next): slots before that are not missed, and the first
    /// [`number`](crate::time::Cycle::number) of one that starts late is that of the grid. Without
    /// a phase, a loop's grid begins when the loop is made, or with
    /// [`Timers::Manager`](crate::time::Timers::Manager) at the slot of phase 0 that lasts then.
    /// O(1).
    ///
    /// [`Overrun::Rephase`] and [`correct`](Self::correct) leave the common grid.
    ///
    /// # Errors
    ///
    /// [`SetupError::PhaseTooLong`]: a phase of a period or more.
    ///
    /// ```
    /// use std::time::Duration;
    /// luna::run(async {
    ///     let period = Duration::from_millis(2);
    ///     let mut sense = luna::periodic("sense", period)?.phase(Duration::ZERO)?;
    ///     let mut act = luna::periodic("act", period)?.phase(period / 2)?;
    ///     let (sensed, acted) = (sense.next().await, act.next().await);
    ///     // Half a period apart, up to whole periods.
    ///     let apart = acted.deadline.as_nanos().abs_diff(sensed.deadline.as_nanos());
    ///     assert_eq!(u128::from(apart) % period.as_nanos(), (period / 2).as_nanos());
    ///     Ok(())
    /// })?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn phase(mut self, phase: Duration) -> Result<Self> {
        self.phase = Some(phase_nanos(self.name().as_str(), phase, self.period())?);
        Ok(self)
    }

    /// Wakes `guard` before each slot, and waits for the slot itself on the clock: pays processor
    /// time for latency.
    ///
    /// What the guard covers of the thread's wake-up no longer makes the cycle late. It costs up to
    /// `guard` of the processor in each period. While the loop spins, processes of its executor
    /// that are ready at its level or above run first, whatever readied them, and each turn of the
    /// spin looks for them. Processes of lower levels are not started, since the loop would be late
    /// by their whole poll: they wait for the slot, `guard` at most. Threads of lower priority on
    /// the same core wait as long. Each turn counts as a poll of the process. Zero, the default, is
    /// no guard, and on a virtual clock there is none. O(1).
    ///
    /// On the reference machine a wake-up takes 26 µs; a good guard is twice the 99th percentile
    /// that [`LoopReport`](crate::report::LoopReport) shows without one.
    ///
    /// # Errors
    ///
    /// [`SetupError::GuardTooLong`]: more than a sixteenth of the period.
    ///
    /// ```
    /// use luna::error::SetupError;
    /// use luna::Error;
    /// use std::time::Duration;
    /// luna::run(async {
    ///     let mut tick = luna::periodic("servo", Duration::from_millis(1))?.guard_spin(Duration::from_micros(60))?;
    ///     let cycle = tick.next().await;
    ///     assert!(luna::now() >= cycle.deadline);
    ///     let long = luna::periodic("hog", Duration::from_millis(1))?.guard_spin(Duration::from_micros(63));
    ///     assert!(matches!(long, Err(Error::Setup(SetupError::GuardTooLong { .. }))));
    ///     Ok(())
    /// })?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn guard_spin(mut self, guard: Duration) -> Result<Self> {
        let longest = self.period / spin::LONGEST_PART;
        if nanos(guard) > longest {
            return Err(SetupError::GuardTooLong {
                name: self.name().as_str().to_owned(),
                guard,
                longest: Duration::from_nanos(longest),
            }
            .into());
        }
        self.guard = nanos(guard);
        Ok(self)
    }

    /// Moves the following slots by `ns` nanoseconds, later if it is positive; gives by how much
    /// they were moved. For a loop that follows another clock, such as a field bus': it calls this
    /// in each cycle with its offset to that.
    ///
    /// In one cycle the slots move by at most a hundredth of the period either way, all calls
    /// together; a period below 100 ns is not moved. What goes beyond that is dropped, not carried
    /// over: the next cycle measures what is left of the offset anew, and would count it twice. A
    /// clock that drifts by less than 1 % is so followed from any offset, within 50 cycles or
    /// somewhat more. Numbers, and with them which slots were missed, stay exact: no slot is
    /// doubled or left out. Real-time path: yes; O(1).
    ///
    /// ```
    /// use std::time::Duration;
    /// luna::run(async {
    ///     let mut tick = luna::periodic("bus", Duration::from_millis(1))?;
    ///     let first = tick.next().await;
    ///     assert_eq!(tick.correct(400), 400);
    ///     assert_eq!(tick.correct(50_000), 9_600); // 10 µs in all
    ///     let second = tick.next().await;
    ///     let periods = u32::try_from(second.number - first.number).unwrap_or(u32::MAX);
    ///     assert_eq!(second.deadline - first.deadline, tick.period() * periods + Duration::from_micros(10));
    ///     Ok(())
    /// })?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn correct(&mut self, ns: i64) -> i64 {
        let moved = self.trim.add(ns, self.period);
        // A loop that has not joined the common grid takes it along when it does.
        if self.phase.is_none() {
            self.grid.shift_behind(self.number, moved);
        }
        moved
    }

    /// Calls a cycle late from this lateness on; if not stated a tenth of the period, at least 50
    /// µs. The report looks for the cause of late cycles ([`LateCycle`](crate::report::LateCycle)),
    /// for three system calls that never wait in such a cycle, about two microseconds;
    /// [`Duration::MAX`] calls none late.
    #[must_use]
    pub fn late_after(mut self, lateness: Duration) -> Self {
        self.statistics().late.set_threshold(lateness);
        self
    }

    /// Reads at the begin of each cycle what the kernel counts of the thread, so that the counts of
    /// a late cycle are those since the cycle before, and show whether another thread had the core.
    /// Three system calls a cycle, about two microseconds: for the search, not for the machine.
    /// Without it they go back to the late cycle before, or the start, and seldom show a cause.
    ///
    /// ```
    /// # use std::time::Duration;
    /// # luna::run(async {
    /// let tick = luna::periodic("sampler", Duration::from_millis(1))?.late_after(Duration::from_micros(200)).accounted();
    /// # drop(tick); Ok(()) })?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    #[must_use]
    pub fn accounted(mut self) -> Self {
        self.statistics().late.account_for_each();
        self
    }

    /// The loop's period.
    pub fn period(&self) -> Duration {
        Duration::from_nanos(self.period)
    }
}
