//! A cycle's end and begin, and the wait between them.

use super::{Cycle, Overrun, Periodic, Prepared};
use crate::csp::supervised::{Failure, fail_current};
use crate::safety::Ledger;
use crate::time::grid::{Grid, Trim};
use crate::time::spin;
use luna_core::current;
use luna_core::timer_queue::Sleep;
use luna_events::{self as events, Kind};
use luna_platform::clock::{Clock, Instant, nanos};
use luna_replay::log as replay;
use std::pin::pin;
use std::time::Duration;

/// What follows the end of a cycle.
enum Then {
    /// The wait for the next slot.
    GoOn,
    /// The process' end, as this poll ends.
    EndsByBudget,
    /// The process' end by this failure.
    Fail(Failure),
}

impl Periodic {
    /// Ends the cycle, and waits for the next slot. With the new cycle the
    /// [parameters](crate::Parameter) of the process that has made the loop get the values that
    /// were set last.
    ///
    /// Real-time path: yes; O(log n) for n delays of this thread, or waits of the manager's
    /// thread; no allocation. Cancel-safe: a wait that is dropped leaves the
    /// slot to the next call. If the [`limit`](Self::limit) is reached it does not return: the
    /// process ends.
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
    #[doc(alias = "tick")]
    pub async fn next(&mut self) -> Cycle {
        if current::has_replay_log() && replay::enters_cycle().await {
            return self.replayed().await;
        }
        let asked = Instant::now();
        if self.prepared.is_some() {
            self.begin_prepared(asked);
        }
        if let Some(phase) = self.phase.take() {
            self.join_common_grid(phase, asked);
        }
        let target = self.grid.slot(self.number.saturating_add(1));
        let (run, then) = self.end_cycle(asked, target);
        match then {
            Then::GoOn => {}
            Then::EndsByBudget => std::future::pending().await,
            Then::Fail(failure) => fail_current(failure).await,
        }
        self.statistics().late.asked(asked, run);
        let now = self.wait_until_slot(asked, target).await;
        let cycle = self.begin_cycle(target, now);
        self.watch = Ledger::cycle_begins(now);
        if current::has_replay_log() {
            replay::note_cycle([
                cycle.number,
                cycle.deadline.as_nanos(),
                nanos(cycle.lateness),
                cycle.missed,
            ]);
        }
        self.latch();
        cycle
    }

    /// Ends the present cycle, if there is one, at `asked`; the next slot is at `target`. Gives how
    /// long the cycle ran, and what follows.
    fn end_cycle(&mut self, asked: Instant, target: Instant) -> (Option<u64>, Then) {
        let Some(began) = self.began.filter(|_| std::mem::take(&mut self.in_cycle)) else {
            return (None, Then::GoOn);
        };
        self.watch = None;
        let run = asked.nanos_since(began);
        self.statistics().report.run_time.record(run);
        // The ledger of the process that runs this cycle: a loop may be handed on.
        if let Some(ledger) = Ledger::current()
            && ledger.cycle_ends(self.name(), began, asked)
        {
            return (Some(run), Then::EndsByBudget);
        }
        if asked <= target {
            self.consecutive = 0;
            return (Some(run), Then::GoOn);
        }
        self.statistics().report.overruns += 1;
        self.consecutive = self.consecutive.saturating_add(1);
        if self.limit.is_some_and(|limit| self.consecutive >= limit) {
            let failure = Failure {
                name: self.name(),
                consecutive: self.consecutive,
            };
            return (Some(run), Then::Fail(failure));
        }
        if self.overrun == Overrun::Rephase {
            self.carried += self.leave_grid(asked);
        }
        (Some(run), Then::GoOn)
    }

    /// Waits until the slot at `target`: asleep until its guard begins, then on the clock. Gives
    /// the time that it read last.
    async fn wait_until_slot(&mut self, asked: Instant, target: Instant) -> Instant {
        if target <= asked {
            // Behind time: still a scheduling point, else it would keep the executor from timers,
            // wakes and its own cancellation.
            luna_core::yield_now().await;
            return Instant::now();
        }
        // Virtual time stands while a process spins.
        let guard = if Clock::is_virtual_here() {
            0
        } else {
            self.guard
        };
        let awake = target - Duration::from_nanos(guard);
        let mut sleep = pin!(Sleep::until(awake));
        if !events::waits_in(self.in_events(), self.wait_for_tick(awake)).await {
            events::waits_in(self.in_events(), sleep.as_mut()).await;
        }
        // Without a guard the slot has come: one look at the clock.
        spin::until(target).await
    }

    /// The cycle from the replay log.
    #[cold]
    async fn replayed(&mut self) -> Cycle {
        let Some([number, deadline, lateness, missed]) = replay::cycle() else {
            // The replay has come to its end.
            return std::future::pending().await;
        };
        replay::hold().await;
        if self.prepared.is_some() {
            self.begin_prepared(Instant::now());
        }
        self.number = number;
        self.come = number;
        self.latch();
        Cycle {
            number,
            deadline: Instant::from_nanos(deadline),
            lateness: Duration::from_nanos(lateness),
            missed,
        }
    }

    /// Takes the parameters that were set last, if its process has any.
    #[inline(always)]
    fn latch(&self) {
        if let Some(parameters) = &self.parameters {
            parameters.latch();
        }
    }

    /// Waits until the manager wakes the loop at `at`; `false` if it does not: the loop then waits
    /// by its executor's deadline.
    async fn wait_for_tick(&self, at: Instant) -> bool {
        match &self.timer_slot {
            Some(timer_slot) => timer_slot.wait(at).await,
            None => false,
        }
    }

    /// Begins a cycle that was scheduled for `target`.
    fn begin_cycle(&mut self, target: Instant, now: Instant) -> Cycle {
        let before = self.number;
        self.come = self.grid.last_at(now).max(before + 1);
        self.number = match self.overrun {
            Overrun::CatchUp => before + 1,
            // The slot that lasts at this moment: later than the one waited for if the wake-up
            // itself came that late.
            Overrun::SkipToGrid | Overrun::Rephase => self.come,
        };
        let skipped = self.number - before - 1;
        let deadline = self.grid.slot(self.number);
        self.trim = Trim::default();
        let previous = self.began.replace(now);
        self.in_cycle = true;
        let number = self.number;
        let statistics = self.statistics();
        statistics.report.cycles += 1;
        events::report(events::code::SLOT, statistics.number, || {
            [number, now.nanos_since(deadline)]
        });
        let is_late = statistics.late.cycle_begins(number, target, now);
        if is_late && events::is_on() {
            statistics.late.report(statistics.number, target, now);
        }
        let report = &mut statistics.report;
        report.missed += skipped;
        report.wake_latency.record(now.nanos_since(target));
        if let Some(previous) = previous {
            report.cycle_time.record(now.nanos_since(previous));
        }
        Cycle {
            number,
            deadline,
            lateness: now - deadline,
            missed: std::mem::take(&mut self.carried) + skipped,
        }
    }
}

impl Periodic {
    /// Begins a loop that was made before its process was here. O(processes with parameters).
    #[cold]
    pub(super) fn begin_prepared(&mut self, now: Instant) {
        let begins = match self.prepared.take() {
            Some(Prepared::AtStart) => self.scope.start(),
            _ => now,
        };
        let origin = self.scope.origin(begins, self.period);
        self.grid = Grid::new(origin, self.period);
        self.grid.shift_behind(self.number, self.trim.nanos());
        self.parameters = self.scope.parameters();
        let name = self.name();
        let statistics = self.statistics();
        events::name_in_ring(Kind::Loop, statistics.number, name.as_str());
        statistics.late.begin_here(now);
    }

    /// Closes the present grid, and joins the one that the loops of its period have in common.
    pub(super) fn join_common_grid(&mut self, phase: u64, now: Instant) {
        self.close_grid(self.come);
        self.begin_grid(Grid::joined_at(
            self.scope.start().plus_nanos(phase),
            self.period,
            now,
        ));
        self.grid.shift_behind(self.number, self.trim.nanos());
    }

    /// Closes the present grid and begins one on which slot 1 is due at `now`; gives how many slots
    /// were missed on the old one. The slot that lasts at `now` is not among them: it is served
    /// late, as the first of the new grid.
    pub(super) fn leave_grid(&mut self, now: Instant) -> u64 {
        let first = now - self.period();
        let missed = self.close_grid(self.grid.last_at(first));
        self.begin_grid(Grid::new(first, self.period));
        missed
    }

    fn begin_grid(&mut self, grid: Grid) {
        self.grid = grid;
        self.number = grid.joined();
        self.come = self.number;
    }

    /// Accounts for all slots of the present grid up to `last`: those that were not served are
    /// missed. Gives their number.
    pub(super) fn close_grid(&mut self, last: u64) -> u64 {
        let elapsed = self.grid.elapsed(last);
        let unserved = last.saturating_sub(self.number);
        let statistics = self.statistics();
        statistics.report.slots_elapsed += elapsed;
        statistics.report.missed += unserved;
        unserved
    }
}
