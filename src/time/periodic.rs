//! Periodic loops: absolute slots, a policy for late ones, and statistics of each cycle.

use super::grid::{Grid, Trim};
use super::manager::TimerSlot;
use super::registry::{LoopName, Scope};
use super::spin;
use super::statistics::Statistics;
use crate::csp::process::{Failure, fail_current};
use crate::error::{Result, SetupError};
use crate::parameters::Reader;
use crate::record;
use crate::safety::Ledger;
use luna_core::current;
use luna_core::events::{self, Kind};
use luna_core::timer_queue::Sleep;
use luna_platform::clock::{Clock, Instant, nanos};
use std::fmt;
use std::panic::{RefUnwindSafe, UnwindSafe};
use std::sync::Arc;
use std::time::Duration;

/// What a loop does about slots that came while it was still busy. Set by [`Periodic::overrun`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Overrun {
    /// Every slot gets its cycle: late ones follow at once, one after the other, until the loop has
    /// caught up. For loops that must do each step, such as an integrator.
    CatchUp,
    /// A slot can be served while it lasts, that is until the next one comes; one that has passed
    /// whole is missed, and the loop stays on its grid. A cycle that is late by less than a period
    /// is thus never lost, and two slots are never served for one.
    #[default]
    SkipToGrid,
    /// The late cycle runs at once and begins a new grid. For loops that need an even distance more
    /// than a fixed phase.
    Rephase,
}

/// One cycle of a periodic loop: what [`Periodic::next`] gives. Its example is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Cycle {
    /// The slot's number on its grid, from 1.
    ///
    /// The grid is the loop's own, or the common one of a loop with a [`phase`](Periodic::phase).
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
    /// Slots that a future which was dropped since has left behind on a former grid.
    carried: u64,
    period: u64,
    overrun: Overrun,
    limit: Option<u32>,
    consecutive: u32,
    /// The slots.
    grid: Grid,
    /// The last slot of the grid that was served, or the one at which the loop joined it.
    number: u64,
    /// The last slot of the grid that had come when the last cycle began, or the loop joined.
    come: u64,
    /// By how much the slots behind `number` have been moved.
    trim: Trim,
    /// The phase on the common grid, until the loop joins that.
    phase: Option<u64>,
    /// How long before a slot the loop is awake.
    guard: u64,
    /// When the last cycle began.
    began: Option<Instant>,
    /// Whether that cycle is still under way.
    in_cycle: bool,
    /// Where the loop waits, if the system has a timer manager.
    slot_of_timer: Option<TimerSlot>,
    /// Whether its slots are still those that it joined: only then the manager ticks for them.
    is_on_grid: bool,
    /// The parameters of the process that has made it.
    parameters: Option<Arc<Reader>>,
    /// Made in a `pre_run`, and not begun yet.
    prepared: Option<Prepared>,
}

/// Where a loop begins that was made in a `pre_run`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Prepared {
    /// With all bodies.
    AtStart,
    /// Beside processes that run, as its body requests the first cycle.
    AtFirstCycle,
}

/// Begins a loop called `name` with slots `period` apart: the first one a period from now, or with
/// [`Timers::Manager`](crate::Timers::Manager) the next one that all loops of this period have.
///
/// Call it in a process, at the start of its body. Deadlines are absolute, so that a late cycle
/// never shifts the following ones. Slots that come while the loop is busy are treated by its
/// [`Overrun`] policy. Real-time path: yes; in a [`System`](crate::System) it allocates nothing,
/// since it takes the room for its statistics from a reserve of the system, of 16 loops or as set
/// by [`System::max_loops`](crate::System::max_loops). O(loops, and processes with
/// [parameters](crate::parameters)).
///
/// In [`pre_run`](crate::Process::pre_run) it makes a loop that begins with the bodies: its first
/// slot is a period after all of them are released; in a process that is spawned while the system
/// runs, a period after the body first requests one.
///
/// Each loop of a system has a line of its own in the report, also when it has ended. So a name is
/// used once, even if the loop of that name was dropped; and a loop that was dropped keeps its room
/// ([`System::max_loops`](crate::System::max_loops)). To loop again keep the `Periodic`, and ask it
/// for the next cycle.
///
/// # Errors
///
/// A [`SetupError`]: a period of zero or of more than 292 years, a name that another loop of the
/// system has or had, a name of more than 63 bytes, more loops than there is room for, or no
/// process around.
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
    let now = Instant::now();
    // With a manager all loops of a period are in phase.
    let origin = match scope.manager() {
        Some(manager) => manager.slot_before(now, length),
        None => now,
    };
    let prepared = Scope::is_preparing().then(|| match scope.has_begun() {
        false => Prepared::AtStart,
        true => Prepared::AtFirstCycle,
    });
    let parameters = match prepared {
        None => scope.parameters(),
        // The process is not here yet; a current process, if any, is another.
        Some(_) => None,
    };
    let slot_of_timer = scope
        .manager()
        .map(|manager| TimerSlot::new(manager.clone(), length));
    Ok(Periodic {
        statistics: Some(statistics),
        scope,
        carried: 0,
        period: length,
        overrun: Overrun::default(),
        limit: None,
        consecutive: 0,
        grid: Grid::new(origin, length),
        number: 0,
        come: 0,
        trim: Trim::default(),
        phase: None,
        guard: 0,
        began: None,
        in_cycle: false,
        slot_of_timer,
        is_on_grid: true,
        parameters,
        prepared,
    })
}

impl Periodic {
    /// Treats slots that come while the loop is busy by `policy`; the default is
    /// [`Overrun::SkipToGrid`].
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
    /// [`number`](Cycle::number) of one that starts late is that of the grid. Without a phase, a
    /// loop's grid begins when the loop is made, or with
    /// [`Timers::Manager`](crate::Timers::Manager) at the slot of phase 0 that lasts then. O(1).
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
        let nanos = nanos(phase);
        if nanos >= self.period {
            return Err(SetupError::PhaseTooLong {
                name: self.name().as_str().to_owned(),
                phase,
                period: self.period(),
            }
            .into());
        }
        self.phase = Some(nanos);
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
    /// that [`LoopReport`](crate::LoopReport) shows without one.
    ///
    /// # Errors
    ///
    /// [`SetupError::GuardTooLong`]: more than a sixteenth of the period.
    ///
    /// ```
    /// use luna::{Error, SetupError};
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
        self.is_on_grid &= moved == 0;
        moved
    }

    /// Calls a cycle late from this lateness on; if not stated a tenth of the period, at least 50
    /// µs. The report looks for the cause of late cycles ([`LateCycle`](crate::LateCycle)), for
    /// three system calls that never wait in such a cycle, about two microseconds;
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

    /// Ends the cycle, and waits for the next slot. With the new cycle the
    /// [parameters](crate::Parameter) of the process that has made the loop get the values that
    /// were set last.
    ///
    /// Real-time path: yes; O(log n) for n delays of this thread, or O(loops) that wait for the
    /// same timer of the manager; no allocation. Cancel-safe: a wait that is dropped leaves the
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
    pub async fn next(&mut self) -> Cycle {
        if current::is_taped() && record::enters_cycle().await {
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
        let mut run = None;
        if let Some(began) = self.began
            && std::mem::take(&mut self.in_cycle)
        {
            run = Some(asked.nanos_since(began));
            self.statistics().run_time.record(asked.nanos_since(began));
            // The ledger of the process that runs this cycle: a loop may be handed on.
            if let Some(ledger) = Ledger::current()
                && ledger.cycle_ends(self.name(), began, asked)
            {
                // The process is ended when this poll is.
                std::future::pending::<()>().await;
            }
            let statistics = self.statistics();
            if asked > target {
                statistics.overruns += 1;
                self.consecutive = self.consecutive.saturating_add(1);
                if self.limit.is_some_and(|limit| self.consecutive >= limit) {
                    let name = self.name();
                    fail_current(Failure::Overrun {
                        name,
                        consecutive: self.consecutive,
                    })
                    .await;
                }
                if self.overrun == Overrun::Rephase {
                    self.carried += self.leave_grid(asked);
                }
            } else {
                self.consecutive = 0;
            }
        }
        self.statistics().late.asked(asked, run);
        if target <= asked {
            // Behind time: still a scheduling point, else it would keep the executor from timers,
            // wakes and its own cancellation.
            luna_executors::yield_now().await;
        } else {
            // Virtual time stands while a process spins.
            let guard = if Clock::is_virtual_here() {
                0
            } else {
                self.guard
            };
            let awake = target - Duration::from_nanos(guard);
            if !events::waits_in(self.in_events(), self.wait_for_tick(awake)).await {
                events::waits_in(self.in_events(), Sleep::until(awake)).await;
            }
        }
        // Without a guard the slot has come: one look at the clock.
        let now = spin::until(target).await;
        let cycle = self.begin_cycle(target, now);
        if current::is_taped() {
            record::note_cycle([
                cycle.number,
                cycle.deadline.as_nanos(),
                nanos(cycle.lateness),
                cycle.missed,
            ]);
        }
        self.latch();
        cycle
    }

    /// The cycle from the replay log.
    #[cold]
    async fn replayed(&mut self) -> Cycle {
        let Some([number, deadline, lateness, missed]) = record::cycle() else {
            // The replay has come to its end.
            return std::future::pending().await;
        };
        record::hold().await;
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

    /// Waits for the manager's tick at `at`; `false` if none comes: the loop then waits by its
    /// executor's deadline.
    async fn wait_for_tick(&mut self, at: Instant) -> bool {
        match &mut self.slot_of_timer {
            Some(slot_of_timer) if self.is_on_grid => slot_of_timer.wait(at).await,
            Some(slot_of_timer) => {
                slot_of_timer.leave();
                false
            }
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
        statistics.kept += 1;
        events::tell(events::code::SLOT, statistics.number, || {
            [number, now.nanos_since(deadline)]
        });
        let is_late = statistics.late.cycle_begins(number, target, now);
        if is_late && events::is_on() {
            statistics.late.tell(statistics.number, target, now);
        }
        statistics.missed += skipped;
        statistics.wake_latency.record(now.nanos_since(target));
        if let Some(previous) = previous {
            statistics.cycle_time.record(now.nanos_since(previous));
        }
        Cycle {
            number,
            deadline,
            lateness: now - deadline,
            missed: std::mem::take(&mut self.carried) + skipped,
        }
    }

    /// Begins a loop that was made before its process was here. O(processes with parameters).
    #[cold]
    fn begin_prepared(&mut self, now: Instant) {
        let begins = match self.prepared.take() {
            Some(Prepared::AtStart) => self.scope.start(),
            _ => now,
        };
        let origin = match self.scope.manager() {
            Some(manager) => manager.slot_before(begins, self.period),
            None => begins,
        };
        self.grid = Grid::new(origin, self.period);
        self.grid.shift_behind(self.number, self.trim.nanos());
        self.parameters = self.scope.parameters();
        let name = self.name();
        let statistics = self.statistics();
        events::name_in_ring(Kind::Loop, statistics.number, name.as_str());
        statistics.late.begin_here(now);
    }

    /// Closes the present grid, and joins the one that the loops of its period have in common.
    fn join_common_grid(&mut self, phase: u64, now: Instant) {
        self.close_grid(self.come);
        self.begin_grid(Grid::joined_at(
            self.scope.start().plus_nanos(phase),
            self.period,
            now,
        ));
        self.grid.shift_behind(self.number, self.trim.nanos());
        self.is_on_grid = self.trim.nanos() == 0;
    }

    /// Closes the present grid and begins one on which slot 1 is due at `now`; gives how many slots
    /// were missed on the old one. The slot that lasts at `now` is not among them: it is served
    /// late, as the first of the new grid.
    fn leave_grid(&mut self, now: Instant) -> u64 {
        let first = now - self.period();
        let missed = self.close_grid(self.grid.last_at(first));
        self.begin_grid(Grid::new(first, self.period));
        self.is_on_grid = false;
        missed
    }

    fn begin_grid(&mut self, grid: Grid) {
        self.grid = grid;
        self.number = grid.joined();
        self.come = self.number;
    }

    /// Accounts for all slots of the present grid up to `last`: those that were not served are
    /// missed. Gives their number.
    fn close_grid(&mut self, last: u64) -> u64 {
        let elapsed = self.grid.elapsed(last);
        let unserved = last.saturating_sub(self.number);
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

    /// What it is in events.
    fn in_events(&self) -> (events::Kind, u32) {
        // Nothing to be left in the code where no events are.
        let number = self.statistics.as_ref().map_or(0, |there| there.number);
        (events::Kind::Loop, number)
    }

    fn name(&self) -> LoopName {
        self.statistics
            .as_ref()
            .map(|statistics| statistics.name)
            .unwrap_or_default()
    }
}

// What it shares with its system is behind a lock under which no user code runs, and its own state
// is whole whenever user code runs: at an await. A loop that a panic left in the middle of a cycle
// goes on with the next slot.
impl UnwindSafe for Periodic {}
impl RefUnwindSafe for Periodic {}

impl Drop for Periodic {
    fn drop(&mut self) {
        // Up to the last cycle's begin: what the process does after its loop is no missed slot.
        self.close_grid(self.come);
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
