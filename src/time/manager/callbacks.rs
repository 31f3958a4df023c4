//! Functions that the manager's thread calls, each slot of a period or once at an instant.

use super::Engine;
use super::heap::Heap;
use super::report::CallbackReport;
use super::timer_groups::Place;
use crate::error::SetupError;
use luna_core::current;
use luna_platform::clock::Instant;
use luna_platform::lock::PiLock;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

/// The argument of a callback: which of its deadlines has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Firing {
    /// The slot's number on the common grid of its period and phase; 0 for an instant.
    pub number: u64,
    /// The slot, or the instant.
    pub deadline: Instant,
    /// From then until the callback was called.
    pub lateness: Duration,
    /// The slots that passed whole since the one before, or since it was set.
    pub missed: u64,
}

/// A callback that takes longer delays all that the manager wakes: it is counted. Also the least
/// rest of a callback that is always late already.
pub(super) const BUDGET: Duration = Duration::from_micros(100);

type Function = Box<dyn FnMut(Firing) + Send>;

/// When a callback is to be called.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wish {
    /// In nanoseconds: a period above zero, and a phase below it.
    Every { period: u64, phase: u64 },
    /// Once.
    At(Instant),
}

pub(super) struct Callbacks {
    table: PiLock<Table>,
}

#[derive(Default)]
struct Table {
    entries: Vec<Entry>,
    /// Places of callbacks that were dropped.
    free: Vec<usize>,
    /// The callbacks with deadlines that the callbacks' timer is armed for.
    timed: Heap,
    /// The callbacks with deadlines for which a timer group ticks.
    ridden: Heap,
    /// The deadline for which the timer is armed.
    armed: Option<u64>,
    /// Number of callbacks that there is room for, once that is settled.
    most: Option<usize>,
    /// When the processes started.
    start: Option<Instant>,
    /// The system is on a virtual clock.
    is_refused: bool,
    has_ended: bool,
    /// Number of dropped callbacks that made room for others.
    replaced: u64,
}

struct Entry {
    /// Taken out while it is called.
    function: Option<Function>,
    /// Changes whenever it is set or cancelled.
    turn: u64,
    wish: Option<Wish>,
    place: Option<Place>,
    /// Its next slot or its instant, and the slot's number.
    deadline: Instant,
    number: u64,
    /// From when on it may be called for an instant that has passed.
    rests_until: Instant,
    is_called: bool,
    is_gone: bool,
    counted: CallbackReport,
}

impl Entry {
    fn new(name: String, function: Function) -> Self {
        Self {
            function: Some(function),
            turn: 0,
            wish: None,
            place: None,
            deadline: Instant::NEVER,
            number: 0,
            rests_until: Instant::from_nanos(0),
            is_called: false,
            is_gone: false,
            counted: CallbackReport {
                name,
                ..CallbackReport::default()
            },
        }
    }

    fn period(&self) -> Option<u64> {
        match self.wish? {
            Wish::Every { period, .. } => Some(period),
            Wish::At(_) => None,
        }
    }
}

impl Callbacks {
    pub(super) fn new() -> Self {
        Self {
            table: PiLock::new(Table::default()),
        }
    }

    /// From now on there is room for `most` callbacks, or for the existing ones if they are more.
    /// Allocates.
    pub(super) fn close_room(&self, most: usize) {
        let mut table = self.table.lock();
        let most = most.max(table.entries.len());
        table.most = Some(most);
        table.reserve(most);
    }

    /// No callback will be called: an error if there is one already, and for each that comes.
    pub(super) fn refuse(&self) -> Result<(), SetupError> {
        let mut table = self.table.lock();
        table.is_refused = true;
        match table.entries.first() {
            None => Ok(()),
            Some(entry) => Err(SetupError::CallbackOnVirtualClock {
                name: entry.counted.name.clone(),
            }),
        }
    }

    /// Adds a callback that is not set; returns its number. Allocates only as long as the room is
    /// not closed, apart from the arguments.
    pub(super) fn add(&self, name: String, function: Function) -> Result<usize, SetupError> {
        let entry = Entry::new(name, function);
        let mut table = self.table.lock();
        if table.is_refused {
            drop(table);
            let name = entry.counted.name;
            return Err(SetupError::CallbackOnVirtualClock { name });
        }
        let number = table.entries.len();
        let Some(most) = table.most else {
            table.entries.push(entry);
            table.reserve(number + 1);
            return Ok(number);
        };
        if number < most {
            table.entries.push(entry);
            return Ok(number);
        }
        let Some(free) = table.free.pop() else {
            drop(table);
            let name = entry.counted.name;
            return Err(SetupError::TooManyTimers { name, most });
        };
        table.replaced += 1;
        let former = std::mem::replace(&mut table.entries[free], entry);
        // Dropped outside of the lock: it is user code.
        drop(table);
        drop(former);
        Ok(free)
    }

    /// Sets it anew. O(log n); at most two system calls.
    pub(super) fn set(&self, callback: usize, wish: Wish, engine: Option<&Engine>) {
        let mut table = self.table.lock();
        table.unset(callback, engine);
        if table.has_ended || table.entries[callback].counted.panicked {
            return;
        }
        table.entries[callback].wish = Some(wish);
        if let (Some(start), Some(engine)) = (table.start, engine) {
            table.enter(callback, start, engine);
            table.arm(engine);
        }
    }

    /// Calls it no more; returns whether it was set. O(log n); at most two system calls.
    pub(super) fn cancel(&self, callback: usize, engine: Option<&Engine>) -> bool {
        let mut table = self.table.lock();
        let was_set = table.unset(callback, engine);
        if let Some(engine) = engine {
            table.arm(engine);
        }
        was_set
    }

    pub(super) fn is_set(&self, callback: usize) -> bool {
        self.table.lock().entries[callback].wish.is_some()
    }

    /// Its handle is gone.
    pub(super) fn release(&self, callback: usize, engine: Option<&Engine>) {
        self.cancel(callback, engine);
        let mut table = self.table.lock();
        let entry = &mut table.entries[callback];
        entry.is_gone = true;
        if !entry.is_called {
            let function = entry.function.take();
            table.free.push(callback);
            // Dropped outside of the lock: it is user code.
            drop(table);
            drop(function);
        }
    }

    /// The processes start: those that were set before count from `start`.
    pub(super) fn begin(&self, start: Instant, engine: &Engine) {
        let mut table = self.table.lock();
        table.start = Some(start);
        for callback in 0..table.entries.len() {
            if table.entries[callback].wish.is_some() {
                table.enter(callback, start, engine);
            }
        }
        table.arm(engine);
    }

    /// Calls the callbacks that are due by now, each once at most; passes the panic of one with its
    /// name to `on_panic`. Manager's thread alone.
    pub(super) fn call_due(&self, engine: &Engine, mut on_panic: impl FnMut(String, String)) {
        let mut table = self.table.lock();
        // A callback that is set during this pass, as those are that rest, comes in the next: ticks
        // and all others come before.
        let due_by = Instant::now();
        for _ in 0..table.entries.len() {
            let now = Instant::now();
            let Some((callback, firing)) = table.take_due(due_by, now) else {
                break;
            };
            let entry = &mut table.entries[callback];
            let Some(mut function) = entry.function.take() else {
                continue;
            };
            let turn = entry.turn;
            entry.is_called = true;
            drop(table);
            let outcome = catch_unwind(AssertUnwindSafe(|| function(firing)));
            let ended = Instant::now();
            let taken = ended - now;
            if let Err(payload) = outcome {
                // It ends the system: what follows need not be in time.
                current::set_on_path(false);
                let message = luna_executors::panic_message(&*payload);
                // Its drop is the user's code too.
                std::mem::forget(payload);
                table = self.table.lock();
                table.unset(callback, Some(engine));
                let counted = &mut table.entries[callback].counted;
                counted.panicked = true;
                let name = counted.name.clone();
                drop(table);
                on_panic(name, message);
            }
            table = self.table.lock();
            // Half of a core at most for one that is always late.
            table.entries[callback].rests_until = ended + taken.max(BUDGET);
            table.was_called(callback, function, firing, taken, turn, engine);
        }
        table.armed = None;
        table.arm(engine);
    }

    /// Stops all calls, and drops the functions. Not for the real-time path.
    pub(super) fn end(&self, engine: Option<&Engine>) {
        let mut functions = Vec::new();
        let mut table = self.table.lock();
        table.has_ended = true;
        for callback in 0..table.entries.len() {
            table.unset(callback, engine);
            functions.extend(table.entries[callback].function.take());
        }
        drop(table);
        for function in functions {
            // The panic hook reports it; the others are to be dropped all the same.
            let _ = catch_unwind(AssertUnwindSafe(|| drop(function)));
        }
    }

    /// The counters, and how many callbacks made room for others. Not for the real-time path.
    pub(super) fn reports(&self) -> (Vec<CallbackReport>, u64) {
        let table = self.table.lock();
        let reports = table.entries.iter().map(|entry| entry.counted.clone());
        (reports.collect(), table.replaced)
    }
}

impl Table {
    fn reserve(&mut self, members: usize) {
        self.entries.reserve(members - self.entries.len());
        self.free.reserve(members - self.free.len());
        self.timed.reserve(members);
        self.ridden.reserve(members);
    }

    /// Takes it out of its heap, and out of its timer group.
    fn unset(&mut self, callback: usize, engine: Option<&Engine>) -> bool {
        self.timed.remove(callback);
        self.ridden.remove(callback);
        let entry = &mut self.entries[callback];
        entry.turn += 1;
        if let (Some(mut place), Some(engine)) = (entry.place.take(), engine) {
            engine.timer_groups.vacate(&mut place, &engine.alarm);
        }
        entry.wish.take().is_some()
    }

    /// Enters one that was just set.
    fn enter(&mut self, callback: usize, start: Instant, engine: &Engine) {
        let entry = &mut self.entries[callback];
        match entry.wish {
            None => return,
            Some(Wish::At(deadline)) => {
                entry.deadline = deadline;
                entry.number = 0;
            }
            Some(Wish::Every { period, phase }) => {
                let origin = start.plus_nanos(phase);
                let now = Instant::now();
                // Before the grid begins the first is slot 1, as of a loop.
                entry.number = now.nanos_since(origin) / period + 1;
                entry.deadline = origin.plus_nanos(period.saturating_mul(entry.number));
                entry.place = Some(Place::new(period));
            }
        }
        self.list(callback, engine);
    }

    /// Puts it into the heap where its deadline belongs. For an instant that has passed it waits
    /// until it has rested since its last call. Otherwise a callback that always sets itself to the
    /// past would be called without end, on a thread above all others, and before them.
    fn list(&mut self, callback: usize, engine: &Engine) {
        let entry = &mut self.entries[callback];
        let is_late = entry.period().is_none()
            && entry.deadline < entry.rests_until
            && entry.deadline <= Instant::now();
        let deadline = if is_late {
            entry.rests_until
        } else {
            entry.deadline
        };
        let deadline = deadline.as_nanos();
        let rides = entry.place.as_mut().is_some_and(|place| {
            engine
                .timer_groups
                .settle(place, entry.deadline, &engine.alarm);
            place.base().is_some()
        });
        let heap = if rides {
            &mut self.ridden
        } else {
            &mut self.timed
        };
        heap.insert(callback, deadline);
    }

    /// Arms the timer for the first deadline that no timer group ticks for.
    fn arm(&mut self, engine: &Engine) {
        let first = self.timed.first().map(|(deadline, _)| deadline);
        if first != self.armed {
            self.armed = first;
            let deadline = first.map_or(Instant::NEVER, Instant::from_nanos);
            engine.alarm.arm_once(deadline);
        }
    }

    /// Takes out the first that was due at `due_by`, with its argument for a call `now`.
    fn take_due(&mut self, due_by: Instant, now: Instant) -> Option<(usize, Firing)> {
        let firsts = [self.timed.first(), self.ridden.first()];
        let (_, callback) = firsts
            .into_iter()
            .flatten()
            .min()
            .filter(|&(deadline, _)| deadline <= due_by.as_nanos())?;
        self.timed.remove(callback);
        self.ridden.remove(callback);
        let entry = &mut self.entries[callback];
        let mut missed = 0;
        if let Some(period) = entry.period() {
            // The slot that lasts now.
            missed = now.nanos_since(entry.deadline) / period;
            entry.number += missed;
            entry.deadline = entry.deadline.plus_nanos(period.saturating_mul(missed));
        } else {
            entry.wish = None;
        }
        let firing = Firing {
            number: entry.number,
            deadline: entry.deadline,
            lateness: now - entry.deadline,
            missed,
        };
        Some((callback, firing))
    }

    fn was_called(
        &mut self,
        callback: usize,
        function: Function,
        firing: Firing,
        taken: Duration,
        turn: u64,
        engine: &Engine,
    ) {
        let entry = &mut self.entries[callback];
        entry.is_called = false;
        entry.function = Some(function);
        let counted = &mut entry.counted;
        counted.calls += 1;
        counted.missed += firing.missed;
        counted.too_long += u64::from(taken > BUDGET);
        counted.longest = counted.longest.max(taken);
        counted.latest = counted.latest.max(firing.lateness);
        if entry.is_gone {
            // Its function is dropped by the next user of the place, or at the end: not here, on
            // the path.
            self.free.push(callback);
        } else if let Some(period) = entry.period()
            && entry.turn == turn
        {
            entry.number += 1;
            entry.deadline = entry.deadline.plus_nanos(period);
            self.list(callback, engine);
        } else if entry.period().is_none() && self.timed.remove(callback) {
            // Set in the call, before the call's end was known.
            self.list(callback, engine);
        }
    }
}
