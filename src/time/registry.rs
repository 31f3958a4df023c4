//! The loops of a system: room for their statistics, set aside before the start, and their names.

use super::late::Witness;
use super::manager::Manager;
use super::statistics::{LoopReport, Statistics};
use crate::error::SetupError;
use arrayvec::ArrayString;
use luna_config::deployment::Deployment;
use luna_config::parameters::{Reader, Store};
use luna_core::ProcessRegistry;
use luna_core::current;
use luna_events::{self as events, Kind};
use luna_platform::clock::{Clock, Instant};
use luna_platform::lock::PiLock;
use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// The name of a loop, in place: to take one allocates nothing.
pub(crate) type LoopName = ArrayString<63>;

/// State that the processes of one system share, found through their thread.
pub(crate) struct Scope {
    loops: PiLock<Loops>,
    /// Whether more room may be allocated on demand: outside of a system, where nothing is started
    /// together.
    grows: bool,
    most: usize,
    /// The origin of the loops' common grids, in nanoseconds.
    start: AtomicU64,
    /// Whether they have started.
    has_begun: AtomicBool,
    has_loops: AtomicBool,
    /// Through this the first loop notifies the thread that runs the system.
    registry: Option<Arc<ProcessRegistry>>,
    clock: Clock,
    /// The manager that wakes the loops, if their executors do not.
    manager: Option<Arc<Manager>>,
    /// The parameters that loops read as their cycles begin.
    parameters: Option<Arc<Store>>,
    /// The system file, which may have other periods.
    deployment: Option<Arc<Deployment>>,
}

#[expect(
    clippy::vec_box,
    reason = "a loop takes its statistics along: a pointer, not a kilobyte of them"
)]
#[derive(Default)]
struct Loops {
    /// Unused room.
    free: Vec<Box<Statistics>>,
    /// Loops that have ended.
    ended: Vec<Box<Statistics>>,
    /// All names that were ever taken.
    names: Vec<LoopName>,
}

thread_local! {
    static SCOPE: RefCell<Option<Arc<Scope>>> = const { RefCell::new(None) };
    /// Whether a `pre_run` runs on this thread: the process is not there yet.
    static IS_PREPARING: Cell<bool> = const { Cell::new(false) };
}

impl Scope {
    /// Reserves room for `most` loops.
    pub(crate) fn with_room_for(
        most: usize,
        registry: Arc<ProcessRegistry>,
        clock: Clock,
        manager: Option<Arc<Manager>>,
        parameters: Arc<Store>,
        deployment: Option<Arc<Deployment>>,
    ) -> Arc<Self> {
        let loops = Loops {
            free: (0..most).map(|_| Box::default()).collect(),
            ended: Vec::with_capacity(most),
            names: Vec::with_capacity(most),
        };
        Arc::new(Self {
            loops: PiLock::new(loops),
            grows: false,
            most,
            has_begun: AtomicBool::new(false),
            registry: Some(registry),
            manager,
            parameters: Some(parameters),
            deployment,
            ..Self::unbounded(clock)
        })
    }

    /// Allocates room on demand.
    pub(crate) fn free_standing() -> Arc<Self> {
        Arc::new(Self::unbounded(Clock::REAL))
    }

    fn unbounded(clock: Clock) -> Self {
        Self {
            loops: PiLock::new(Loops::default()),
            grows: true,
            most: 0,
            start: AtomicU64::new(clock.now().as_nanos()),
            has_begun: AtomicBool::new(true),
            has_loops: AtomicBool::new(false),
            registry: None,
            clock,
            manager: None,
            parameters: None,
            deployment: None,
        }
    }

    /// The processes start now. To be called before the first of them runs.
    pub(crate) fn begin(&self) -> Instant {
        let now = self.clock.now();
        // A process that is released sees what came before the release.
        self.start.store(now.as_nanos(), Ordering::Relaxed);
        self.has_begun.store(true, Ordering::Relaxed);
        if let Some(manager) = &self.manager {
            manager.begin(now);
        }
        now
    }

    /// When the processes started.
    pub(crate) fn start(&self) -> Instant {
        Instant::from_nanos(self.start.load(Ordering::Relaxed))
    }

    /// Whether the processes have started.
    pub(crate) fn has_begun(&self) -> bool {
        self.has_begun.load(Ordering::Relaxed)
    }

    /// The manager that wakes the loops, if their executors do not.
    pub(crate) fn manager(&self) -> Option<&Arc<Manager>> {
        self.manager.as_ref()
    }

    /// Where the grid of a loop lies that begins at `now`.
    pub(crate) fn origin(&self, now: Instant, period: u64) -> Instant {
        let manager = self.manager.as_ref();
        manager.map_or(now, |manager| manager.slot_before(now, period))
    }

    /// The parameters that a loop of the current process reads at each cycle's begin, if the
    /// process has any.
    pub(crate) fn parameters(&self) -> Option<Arc<Reader>> {
        let store = self.parameters.as_ref()?;
        store.reader(current::process(|process| {
            process.map(|process| process.id())
        })?)
    }

    /// The period of a loop for which the program states `period`. Allocates nothing.
    pub(crate) fn period(&self, name: &str, period: Duration) -> Duration {
        match &self.deployment {
            Some(deployment) => deployment.period(name, period),
            None => period,
        }
    }

    /// Makes this the scope of the calling thread, for as long as the thread lives.
    pub(crate) fn enter_thread(self: &Arc<Self>) {
        SCOPE.set(Some(self.clone()));
    }

    /// Makes this the scope of the calling thread until the guard is dropped. `is_preparing` is for
    /// a `pre_run`: the process that owns the loops made there is known only when they begin.
    pub(crate) fn enter_until_dropped(self: Arc<Self>, is_preparing: bool) -> Entered {
        Entered {
            before: SCOPE.replace(Some(self)),
            was_preparing: IS_PREPARING.replace(is_preparing),
        }
    }

    /// Whether a `pre_run` runs on this thread.
    pub(crate) fn is_preparing() -> bool {
        IS_PREPARING.get()
    }

    /// The scope of this thread.
    pub(crate) fn current() -> Option<Arc<Scope>> {
        SCOPE.with_borrow(Clone::clone)
    }

    /// Whether any loop was begun.
    pub(crate) fn has_loops(&self) -> bool {
        self.has_loops.load(Ordering::Relaxed)
    }

    /// Takes a name and room for its statistics. Allocates nothing in a system; O(loops), to
    /// compare the names. The first one makes a system call, to notify the thread that runs the
    /// system.
    pub(crate) fn enroll(
        self: &Arc<Self>,
        name: &str,
        period: Duration,
    ) -> Result<Box<Statistics>, SetupError> {
        let short = LoopName::from(name).map_err(|_| SetupError::NameTooLong {
            name: name.to_owned(),
            most: LoopName::new().capacity(),
        })?;
        let made = self.grows.then(Box::<Statistics>::default);
        let mut loops = self.loops.lock();
        if loops.names.contains(&short) {
            drop(loops);
            return Err(SetupError::DuplicateName {
                kind: "loop",
                name: name.to_owned(),
            });
        }
        let Some(mut statistics) = made.or_else(|| loops.free.pop()) else {
            drop(loops);
            return Err(SetupError::TooManyLoops {
                name: name.to_owned(),
                most: self.most,
            });
        };
        loops.names.push(short);
        statistics.name = short;
        statistics.number = loops.names.len() as u32;
        drop(loops);
        if !Self::is_preparing() {
            events::name_in_ring(Kind::Loop, statistics.number, name);
        }
        statistics.report.period = period;
        if self.grows {
            // It is not reported.
            statistics.late.set_threshold(Duration::MAX);
        } else {
            statistics.late.begin(period, Instant::now());
        }
        if !self.has_loops.swap(true, Ordering::Relaxed)
            && let Some(registry) = &self.registry
        {
            registry.announce();
        }
        Ok(statistics)
    }

    /// Takes back the statistics of a loop that has ended. O(1); the room for it was made with the
    /// statistics.
    pub(crate) fn retire(&self, statistics: Box<Statistics>) {
        self.loops.lock().ended.push(statistics);
    }

    /// The reports of the loops that have ended, by their names. Not for the real-time path.
    pub(crate) fn take_reports(&self, witness: &Witness<'_>) -> BTreeMap<String, LoopReport> {
        let ended = std::mem::take(&mut self.loops.lock().ended);
        ended
            .into_iter()
            .map(|loops| {
                let name = loops.name.as_str().to_owned();
                (name, loops.into_report(witness))
            })
            .collect()
    }
}

/// Restores the thread's scope from before.
pub(crate) struct Entered {
    before: Option<Arc<Scope>>,
    was_preparing: bool,
}

impl Drop for Entered {
    fn drop(&mut self) {
        SCOPE.set(self.before.take());
        IS_PREPARING.set(self.was_preparing);
    }
}
