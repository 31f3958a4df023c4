//! The functions that bring the machine to safety. The failover sequence decides which worker runs
//! which function; this module holds the functions and their outcomes.

use crate::error::{Result, SetupError};
use luna_machine::failover::{FailoverSequence, Leg, Turn};
use luna_machine::signals;
use luna_platform::clock::Instant;
use luna_platform::lock::PiLock;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// How long a function may take unless stated.
pub(crate) const LIMIT: Duration = Duration::from_millis(500);

/// The most functions of a kind. Their room is reserved beforehand, so that a late registration
/// finds it.
const MAX: usize = 256;

/// How often, at most, a watching worker checks whether a function with a shorter limit has begun
/// meanwhile.
const SHORTEST_LOOK: Duration = Duration::from_millis(1);

/// The outcome of one function: in
/// [`SafetyReport::functions`](crate::report::SafetyReport::functions).
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct FunctionReport {
    /// Its name.
    pub name: String,
    /// How long it was allowed to take, on the machine's clock.
    pub limit: Duration,
    /// Its outcome.
    pub outcome: FunctionOutcome,
    /// From the trigger until it began, if it did.
    pub began_after: Option<Duration>,
    /// How long it took; of one that was left behind, until then.
    pub took: Option<Duration>,
    /// It was to run and did not: so many functions hang that no thread was left to run it while
    /// another one watches.
    pub no_thread_left: bool,
}

/// The outcome of a function. A withdrawn function is not reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum FunctionOutcome {
    /// There was no reason to run it, or there is none any more, since the state was reset; or
    /// [no thread was left](FunctionReport::no_thread_left) for it.
    #[default]
    NotRun,
    /// It has run, to its end.
    Ran,
    /// It panicked; the others ran.
    Panicked,
    /// It took longer than its limit, or its thread crashed: another thread went on with the
    /// others. It may have ended later, at low priority.
    LeftBehind,
}

impl fmt::Display for FunctionReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}` ", self.name)?;
        match self.outcome {
            FunctionOutcome::NotRun if self.no_thread_left => {
                return f.write_str("did not run: too many others hang, and no thread is left");
            }
            FunctionOutcome::NotRun => return f.write_str("did not run"),
            FunctionOutcome::Ran => f.write_str("ran")?,
            FunctionOutcome::Panicked => f.write_str("panicked")?,
            FunctionOutcome::LeftBehind => {
                write!(f, "was left behind, its limit being {:?}", self.limit)?;
            }
        }
        if let (Some(began), Some(took)) = (self.began_after, self.took) {
            write!(f, ", from {began:?} after the trigger for {took:?}")?;
        }
        Ok(())
    }
}

pub(crate) type Run = Box<dyn FnMut() + Send>;

struct Slot {
    id: u64,
    report: FunctionReport,
    /// None while it runs, and once it was withdrawn, has hung, or will not run again.
    run: Option<Run>,
    is_withdrawn: bool,
    /// When it began, while it runs.
    running: Option<Instant>,
}

/// A point in the run of a function, on the thread that runs it.
pub(super) enum Moment {
    /// The function is about to be called. If it is the first since the trigger: the instant at
    /// which a worker is to check it.
    Begins(Option<Instant>),
    /// It has ended.
    Ended,
}

/// The next task of a worker.
pub(super) enum Task {
    /// It was run. False: this worker was left behind meanwhile, and is to end.
    Ran(bool),
    /// Another worker hangs, and this one has left it behind: the number of the worker that hangs.
    LeftBehind(u8),
    /// Check again at this instant, or on an event.
    Until(Instant),
}

/// What a worker may do with a function that is to be run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Assignment {
    /// Run it.
    Run,
    /// Leave it to others, or wait until another one can watch.
    Wait,
    /// Give it up, and those behind it: there will never be another worker to watch.
    GiveUp,
}

/// Functions that run one after the other.
pub(crate) struct Functions {
    pub(super) failover: FailoverSequence,
    /// By the numbers of the failover, and in the order of their ids.
    slots: PiLock<Vec<Slot>>,
    next_id: AtomicU64,
    /// The instant of the trigger, 0 before.
    triggered: AtomicU64,
    /// Whether one was called since then.
    has_called: AtomicBool,
}

impl Functions {
    pub(super) fn new() -> Self {
        Self {
            failover: FailoverSequence::new(),
            slots: PiLock::new(Vec::with_capacity(MAX)),
            next_id: AtomicU64::new(0),
            triggered: AtomicU64::new(0),
            has_called: AtomicBool::new(false),
        }
    }

    /// Adds a function behind the others. Returns its id.
    pub(crate) fn add(&self, name: &str, limit: Duration, run: Run) -> Result<u64> {
        let too_many = || SetupError::TooManyFunctions {
            name: name.to_owned(),
            most: MAX,
        };
        let over = || SetupError::EmergencyOver {
            name: name.to_owned(),
        };
        let mut slot = Slot {
            id: 0,
            report: FunctionReport {
                name: name.to_owned(),
                limit,
                ..FunctionReport::default()
            },
            run: Some(run),
            is_withdrawn: false,
            running: None,
        };
        let mut slots = self.slots.lock();
        if slots.len() >= MAX {
            drop(slots);
            return Err(too_many().into());
        }
        // Under the lock, so that the worker that gets this number finds the function.
        let Some(number) = self.failover.add() else {
            drop(slots);
            return Err(over().into());
        };
        debug_assert_eq!(number, slots.len());
        let id = self.next_id.fetch_add(1, Ordering::Relaxed);
        slot.id = id;
        slots.push(slot);
        drop(slots);
        if self.failover.is_under_way() {
            // Watching workers sleep for the shortest limit that they knew of.
            signals::announce_event();
        }
        Ok(id)
    }

    /// Withdraws a function. Returns whether it had not begun. If none has begun, its slot is free
    /// again. A function that has run is still reported: its device is closed after it.
    pub(super) fn withdraw(&self, id: u64) -> bool {
        // User code: dropped without the lock.
        let (is_withdrawn, _taken, _place) = {
            let mut slots = self.slots.lock();
            let Ok(number) = slots.binary_search_by_key(&id, |slot| slot.id) else {
                return false;
            };
            let slot = &mut slots[number];
            let taken = slot.run.take();
            let is_withdrawn = taken.is_some() && slot.report.began_after.is_none();
            slot.is_withdrawn |= is_withdrawn;
            // Under the lock, so that a worker that gets a number finds the right function.
            let is_free = is_withdrawn && self.failover.remove();
            (is_withdrawn, taken, is_free.then(|| slots.remove(number)))
        };
        is_withdrawn
    }

    /// Begins, unless it has begun; `now` is then the instant of the trigger.
    pub(super) fn begin(&self, now: Instant) -> bool {
        // The first trigger's instant stays.
        let now = now.as_nanos().max(1);
        let _ = self
            .triggered
            .compare_exchange(0, now, Ordering::Relaxed, Ordering::Relaxed);
        self.failover.begin()
    }

    /// Resets it if that is possible. Returns whether it did.
    pub(crate) fn may_reset(&self) -> bool {
        if self.failover.is_under_way() {
            return false;
        }
        for slot in self.slots.lock().iter_mut() {
            (slot.report.began_after, slot.report.took) = (None, None);
            slot.report.no_thread_left = false;
            // A function that hangs is not run again.
            if slot.report.outcome != FunctionOutcome::LeftBehind {
                slot.report.outcome = FunctionOutcome::NotRun;
            }
        }
        self.failover.again();
        self.triggered.store(0, Ordering::Relaxed);
        self.has_called.store(false, Ordering::Relaxed);
        true
    }

    /// Whether the functions have begun, and none was called yet.
    pub(super) fn wait_for_the_first(&self) -> bool {
        self.failover.is_under_way() && !self.has_called.load(Ordering::Acquire)
    }

    /// Passes on how long all of them may take together. Under the lock, so that the last call has
    /// the limits of all.
    pub(super) fn report_limits(&self, report: impl FnOnce(Duration)) {
        let slots = self.slots.lock();
        let there = slots.iter().filter(|slot| !slot.is_withdrawn);
        let limits = there.map(|slot| slot.report.limit);
        report(limits.fold(Duration::ZERO, Duration::saturating_add));
    }

    /// Does what there is to do for the worker with `duty`. `around` is called when a function
    /// begins and when it has ended: it sets up what the system needs of the thread meanwhile.
    pub(super) fn step(
        &self,
        duty: Leg,
        has_crashed: impl Fn(u8) -> bool,
        around: impl Fn(Moment),
    ) -> Task {
        match duty {
            // One that may not begin a function looks again: nothing tells it that it may.
            Leg::Rest if self.failover.is_under_way() => {
                Task::Until(Instant::now_real() + SHORTEST_LOOK)
            }
            Leg::Rest => Task::Until(Instant::NEVER),
            Leg::Run(turn) => Task::Ran(self.run(turn, around)),
            Leg::Watch(turn) => self.watch(turn, has_crashed(turn.member())),
        }
    }

    /// The duty of `member`, which may do what `assignment` says with a function that is to be run.
    pub(super) fn take(&self, member: u8, assignment: Assignment) -> Leg {
        match assignment {
            Assignment::Run => self.failover.take(member),
            Assignment::Wait => self.failover.look(),
            Assignment::GiveUp => {
                // Under the lock, so that no number is given meanwhile. Whoever sees that they are
                // done then waits for what is noted here.
                let mut slots = self.slots.lock();
                if let Some(first) = self.failover.give_up() {
                    for slot in slots[first..].iter_mut().filter(|slot| slot.run.is_some()) {
                        slot.report.no_thread_left = true;
                    }
                }
                drop(slots);
                self.failover.look()
            }
        }
    }

    /// Runs the next function.
    fn run(&self, turn: Turn, around: impl Fn(Moment)) -> bool {
        let began = Instant::now_real();
        let (run, shortest) = {
            let mut slots = self.slots.lock();
            let shortest = shortest(&slots[turn.job()..]);
            let slot = &mut slots[turn.job()];
            if slot.run.is_some() {
                slot.running = Some(began);
                slot.report.began_after =
                    Some(began - Instant::from_nanos(self.triggered.load(Ordering::Relaxed)));
            }
            (slot.run.take(), shortest)
        };
        let Some(mut run) = run else {
            // Withdrawn, or it has hung in an earlier round.
            return self.failover.finish(turn);
        };
        let is_first = !self.has_called.load(Ordering::Relaxed);
        around(Moment::Begins(is_first.then(|| began + shortest)));
        // After the clock is read: a worker that sees this flag reads the clock later.
        self.has_called.store(true, Ordering::Release);
        // The others must run whatever this one does.
        let outcome = match catch_unwind(AssertUnwindSafe(&mut run)) {
            Ok(()) => FunctionOutcome::Ran,
            Err(payload) => {
                // Its drop is user code too.
                std::mem::forget(payload);
                FunctionOutcome::Panicked
            }
        };
        around(Moment::Ended);
        let mut slots = self.slots.lock();
        if slots[turn.job()].report.outcome == FunctionOutcome::LeftBehind {
            // Nothing else refers to the function now. Its drop is user code and runs at low
            // priority.
            drop(slots);
            drop(run);
            return false;
        }
        let slot = &mut slots[turn.job()];
        slot.report.outcome = outcome;
        slot.report.took = slot.running.take().map(|began| Instant::now_real() - began);
        slot.run = Some(run);
        // Under the lock, as the watching worker's decision is: one of the two comes first.
        self.failover.finish(turn)
    }

    /// Leaves the worker that runs a function behind if the function takes too long.
    fn watch(&self, turn: Turn, has_crashed: bool) -> Task {
        let now = Instant::now_real();
        let mut slots = self.slots.lock();
        let shortest = shortest(&slots[turn.job()..]);
        let slot = &mut slots[turn.job()];
        // Also if the worker is between its turn and the function's begin.
        let until = slot.running.unwrap_or(now) + slot.report.limit;
        if now < until && !has_crashed {
            return Task::Until(until.min(now + shortest));
        }
        if !self.failover.leave_behind(turn) {
            // It has just ended.
            return Task::Until(now);
        }
        slot.report.outcome = FunctionOutcome::LeftBehind;
        slot.report.took = slot.running.take().map(|began| now - began);
        Task::LeftBehind(turn.member())
    }

    /// Returns the outcomes, and the functions, which the caller drops.
    pub(super) fn conclude(&self) -> (Vec<FunctionReport>, Vec<Run>) {
        let mut slots = self.slots.lock();
        let reports = slots
            .iter()
            .filter(|slot| !slot.is_withdrawn)
            .map(|slot| slot.report.clone())
            .collect();
        let runs = slots
            .iter_mut()
            .filter_map(|slot| slot.run.take())
            .collect();
        (reports, runs)
    }
}

/// The latest instant at which a worker is to check whether one of these takes too long.
fn shortest(slots: &[Slot]) -> Duration {
    let shortest = slots.iter().map(|slot| slot.report.limit).min();
    shortest.unwrap_or(LIMIT).max(SHORTEST_LOOK)
}

impl fmt::Debug for Functions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.failover.fmt(f)
    }
}
