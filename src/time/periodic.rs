//! Periodic loops: absolute slots, a policy for late ones, and statistics of each cycle.

mod cycle;
mod options;

use super::grid::{Grid, Trim};
use super::manager::TimerSlot;
use super::period::period_nanos;
use super::registry::{LoopName, Scope};
use super::statistics::Statistics;
use crate::error::{Result, SetupError};
use crate::safety::CycleWatch;
use luna_config::parameters::Reader;
use luna_events as events;
use luna_platform::clock::Instant;
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
    /// For a cycle that never ends, if it has a budget.
    watch: Option<CycleWatch>,
    /// Where the loop waits, if the system has a timer manager.
    timer_slot: Option<TimerSlot>,
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
/// [`Timers::Manager`](crate::time::Timers::Manager) the next one that all loops of this period
/// have.
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
/// The system's [file](crate::System::deployment_from) may set another period than `period`: what
/// a body computes from its period it takes from [`Periodic::period`].
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
#[doc(alias = "interval")]
pub fn periodic(name: impl AsRef<str>, period: Duration) -> Result<Periodic> {
    make(name.as_ref(), period)
}

/// See [`periodic`].
fn make(name: &str, period: Duration) -> Result<Periodic> {
    let scope = Scope::current().ok_or_else(|| SetupError::NoProcess {
        name: name.to_owned(),
    })?;
    // Also if the system file has another.
    period_nanos(name, period)?;
    let period = scope.period(name, period);
    let length = period_nanos(name, period)?;
    let statistics = scope.enroll(name, period)?;
    let now = Instant::now();
    // With a manager all loops of a period are in phase.
    let origin = scope.origin(now, length);
    let prepared = Scope::is_preparing().then(|| match scope.has_begun() {
        false => Prepared::AtStart,
        true => Prepared::AtFirstCycle,
    });
    let parameters = match prepared {
        None => scope.parameters(),
        // The process is not here yet; a current process, if any, is another.
        Some(_) => None,
    };
    let timer_slot = scope.manager().and_then(|manager| TimerSlot::new(manager));
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
        watch: None,
        timer_slot,
        parameters,
        prepared,
    })
}

impl Periodic {
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

luna_platform::debug_fields!(
    Periodic, |periodic|
    name: periodic.name(),
    period: periodic.period(),
    number: periodic.number
);
