//! Periodic loops: absolute slots, a policy for late ones, and statistics of each cycle.

use super::registry::{LoopName, Scope};
use super::statistics::Statistics;
use crate::csp::process::{Failure, fail_current};
use crate::error::{Result, SetupError};
use luna_platform::clock::{Instant, nanos};
use luna_platform::timer_queue::Sleep;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

/// What a loop does about slots that came while it was still busy. Set by [`Periodic::overrun`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Overrun {
    /// Every slot gets its cycle: late ones follow at once, one after the other, until the loop has caught up. For loops that must
    /// do each step, such as an integrator.
    CatchUp,
    /// A slot can be served while it lasts, that is until the next one comes; one that has passed whole is missed, and the loop
    /// stays on its grid. A cycle that is late by less than a period is thus never lost, and two slots are never served for one.
    #[default]
    SkipToGrid,
    /// The late cycle runs at once and begins a new grid. For loops whose distance matters more than their phase.
    Rephase,
}

/// One cycle of a periodic loop: what [`Periodic::next`] gives. Its example is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Cycle {
    /// The slot's number on its grid, from 1.
    pub number: u64,
    /// When the slot began.
    pub deadline: Instant,
    /// From then until the cycle did: always less than a period if slots are skipped.
    pub lateness: Duration,
    /// The slots that were missed since the cycle before.
    pub missed: u64,
}

/// A periodic loop: see [`periodic`].
///
/// Dropping it ends the loop and hands its statistics to the report.
pub struct Periodic {
    /// Always there until the drop.
    statistics: Option<Box<Statistics>>,
    scope: Arc<Scope>,
    period: u64,
    overrun: Overrun,
    limit: Option<u32>,
    consecutive: u32,
    /// Slot 0 of the present grid.
    origin: Instant,
    /// The last slot of the present grid that was served.
    number: u64,
    /// When the last cycle began.
    began: Option<Instant>,
    /// Whether that cycle is still under way.
    in_cycle: bool,
}

/// Begins a loop called `name` whose slots are `period` apart: the first one a period from now.
///
/// Call it in a process, at the start of its body. Deadlines are absolute, so that a late cycle never shifts the following ones. Slots
/// that come while the loop is busy are treated by its [`Overrun`] policy. Real-time path: yes; in a [`System`](crate::System) it allocates
/// nothing, since the statistics' room is set aside before the start. O(loops).
///
/// # Errors
///
/// A [`SetupError`]: a period of zero or of more than 292 years, a name that another loop of the system has, a name of more than 63 bytes,
/// more loops than there is room for, or no process around.
///
/// ```
/// use std::time::Duration;
/// luna::run(async {
///     let mut tick = luna::periodic("blink", Duration::from_millis(1))?;
///     for _ in 0..3 {
///         let cycle = tick.next().await;
///         assert!(luna::now() >= cycle.deadline);
///     }
///     Ok(())
/// })?;
/// # Ok::<(), luna::Error>(())
/// ```
pub fn periodic(name: &str, period: Duration) -> Result<Periodic> {
    let named = || name.to_owned();
    let scope = Scope::current().ok_or_else(|| SetupError::NoProcess { name: named() })?;
    let length = nanos(period);
    if length == 0 {
        return Err(SetupError::ZeroPeriod { name: named() }.into());
    }
    if length > i64::MAX as u64 {
        return Err(SetupError::PeriodTooLong {
            name: named(),
            period,
        }
        .into());
    }
    let statistics = scope.enroll(name, period)?;
    Ok(Periodic {
        statistics: Some(statistics),
        scope,
        period: length,
        overrun: Overrun::default(),
        limit: None,
        consecutive: 0,
        origin: Instant::now(),
        number: 0,
        began: None,
        in_cycle: false,
    })
}

impl Periodic {
    /// Treats slots that come while the loop is busy by `policy`; the default is [`Overrun::SkipToGrid`].
    ///
    /// ```
    /// # use std::time::Duration;
    /// # luna::run(async {
    /// let tick = luna::periodic("integrator", Duration::from_millis(1))?.overrun(luna::Overrun::CatchUp);
    /// # drop(tick); Ok(()) })?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    #[must_use]
    pub fn overrun(mut self, policy: Overrun) -> Self {
        self.overrun = policy;
        self
    }

    /// Ends the process with [`Error::Overrun`](crate::Error::Overrun) when `cycles` cycles in a row were late, that is when the loop
    /// came back after the next slot had begun. A cycle in time begins the count anew. 0 counts as 1.
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

    /// The loop's period.
    pub fn period(&self) -> Duration {
        Duration::from_nanos(self.period)
    }

    /// Ends the cycle, and waits for the next slot.
    ///
    /// Real-time path: yes; O(log n) for n delays of this thread, no allocation. Cancel-safe: a wait that is dropped leaves the
    /// slot to the next call. If the [`limit`](Self::limit) is reached it does not return: the process ends.
    ///
    /// ```
    /// use std::time::Duration;
    /// luna::run(async {
    ///     let mut tick = luna::periodic("count", Duration::from_millis(1))?;
    ///     let first = tick.next().await;
    ///     let second = tick.next().await;
    ///     assert_eq!(second.number, first.number + second.missed + 1);
    ///     assert!(second.lateness < tick.period());
    ///     Ok(())
    /// })?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub async fn next(&mut self) -> Cycle {
        let asked = Instant::now();
        let target = self
            .origin
            .plus_nanos(self.period.saturating_mul(self.number.saturating_add(1)));
        let mut missed = 0;
        if let Some(began) = self.began
            && std::mem::take(&mut self.in_cycle)
        {
            let statistics = self.statistics();
            statistics.run_time.record(asked.nanos_since(began));
            if asked > target {
                statistics.overruns += 1;
                self.consecutive += 1;
                if self.limit.is_some_and(|limit| self.consecutive >= limit) {
                    let name = self.name();
                    fail_current(Failure::Overrun {
                        name,
                        consecutive: self.consecutive,
                    })
                    .await;
                }
                if self.overrun == Overrun::Rephase {
                    missed = self.leave_grid(asked);
                }
            } else {
                self.consecutive = 0;
            }
        }
        if target <= asked {
            // Behind time: still a scheduling point, else it would keep the executor from timers, wakes and its own cancellation.
            luna_executors::yield_now().await;
        } else {
            Sleep::until(target).await;
        }
        self.begin_cycle(target, missed, Instant::now())
    }

    /// Begins a cycle that was scheduled for `target`, `missed` slots having been missed on a grid that was left.
    fn begin_cycle(&mut self, target: Instant, missed: u64, now: Instant) -> Cycle {
        let before = self.number;
        let due = now.nanos_since(self.origin) / self.period;
        self.number = match self.overrun {
            Overrun::CatchUp => before + 1,
            // The slot that lasts at this moment: later than the one waited for if the wake-up itself came that late.
            Overrun::SkipToGrid | Overrun::Rephase => due.max(before + 1),
        };
        let skipped = self.number - before - 1;
        let deadline = self
            .origin
            .plus_nanos(self.period.saturating_mul(self.number));
        let previous = self.began.replace(now);
        self.in_cycle = true;
        let number = self.number;
        let statistics = self.statistics();
        statistics.kept += 1;
        statistics.missed += skipped;
        statistics.wake_latency.record(now.nanos_since(target));
        if let Some(previous) = previous {
            statistics.cycle_time.record(now.nanos_since(previous));
        }
        Cycle {
            number,
            deadline,
            lateness: now - deadline,
            missed: missed + skipped,
        }
    }

    /// Closes the present grid and begins one on which slot 1 is due at `now`; gives how many slots were missed on the old one. The slot that
    /// lasts at `now` is not among them: it is served late, as the first of the new grid.
    fn leave_grid(&mut self, now: Instant) -> u64 {
        let first = Instant::from_nanos(now.as_nanos().saturating_sub(self.period));
        let missed = self.close_grid(first);
        self.origin = first;
        self.number = 0;
        missed
    }

    /// Accounts for all slots of the present grid up to `until`: those that were not served are missed. Gives their number.
    fn close_grid(&mut self, until: Instant) -> u64 {
        let elapsed = until.nanos_since(self.origin) / self.period;
        let unserved = elapsed.saturating_sub(self.number);
        let statistics = self.statistics();
        statistics.slots_elapsed += elapsed;
        statistics.missed += unserved;
        unserved
    }

    fn statistics(&mut self) -> &mut Statistics {
        self.statistics
            .as_mut()
            .expect("the statistics are there until the drop")
    }

    fn name(&self) -> LoopName {
        self.statistics
            .as_ref()
            .map(|statistics| statistics.name)
            .unwrap_or_default()
    }
}

impl Drop for Periodic {
    fn drop(&mut self) {
        // Up to the last cycle's begin: what the process does after its loop is no missed slot.
        self.close_grid(self.began.unwrap_or(self.origin));
        if let Some(statistics) = self.statistics.take() {
            self.scope.retire(statistics);
        }
    }
}

impl fmt::Debug for Periodic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Periodic")
            .field("name", &self.name())
            .field("period", &self.period())
            .field("number", &self.number)
            .finish_non_exhaustive()
    }
}
