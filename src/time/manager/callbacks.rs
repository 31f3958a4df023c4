//! Functions that the manager's thread calls, each slot of a period or once at an instant.

use super::CallbackReport;
use super::Engine;
use crate::error::SetupError;
use luna_core::current;
use luna_core::timer_queue::Deadline;
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

#[derive(Default)]
pub(super) struct Callbacks {
    table: PiLock<Table>,
}

#[derive(Default)]
struct Table {
    entries: Vec<Entry>,
    /// Places of callbacks that were dropped.
    free: Vec<usize>,
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
    /// Its number in the table.
    place: u32,
    /// Taken out while it is called.
    function: Option<Function>,
    /// Changes whenever it is set or cancelled.
    turn: u64,
    wish: Option<Wish>,
    /// Where it waits in the manager's queue.
    armed: Deadline,
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
            place: 0,
            function: Some(function),
            turn: 0,
            wish: None,
            armed: Deadline::new(),
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
    /// From now on there is room for `most` callbacks, or for the existing ones if they are more.
    /// Allocates.
    pub(super) fn close_room(&self, most: usize) {
        let mut table = self.table.lock();
        let most = most.max(table.entries.len());
        table.most = Some(most);
        table.reserve(most);
    }

    /// How many may be due at a time.
    pub(super) fn room(&self) -> usize {
        let table = self.table.lock();
        table.most.unwrap_or(0)
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
        let mut entry = Entry::new(name, function);
        let mut table = self.table.lock();
        if table.is_refused {
            drop(table);
            let name = entry.counted.name;
            return Err(SetupError::CallbackOnVirtualClock { name });
        }
        let number = table.entries.len();
        let is_open = table.most.is_none();
        let most = table.most.unwrap_or(usize::MAX);
        if number < most {
            entry.place = number as u32;
            table.entries.push(entry);
            if is_open {
                table.reserve(number + 1);
            }
            return Ok(number);
        }
        let Some(free) = table.free.pop() else {
            drop(table);
            let name = entry.counted.name;
            return Err(SetupError::TooManyTimers { name, most });
        };
        table.replaced += 1;
        entry.place = free as u32;
        let former = std::mem::replace(&mut table.entries[free], entry);
        // Dropped outside of the lock: it is user code.
        drop(table);
        drop(former);
        Ok(free)
    }

    /// Sets it anew. O(log n); at most one system call.
    pub(super) fn set(&self, callback: usize, wish: Wish, engine: Option<&Engine>) {
        let mut table = self.table.lock();
        table.unset(callback);
        if table.has_ended || table.entries[callback].counted.panicked {
            return;
        }
        table.entries[callback].wish = Some(wish);
        if let (Some(start), Some(engine)) = (table.start, engine) {
            table.entries[callback].enter(start, engine);
        }
    }

    /// Calls it no more; returns whether it was set. O(log n).
    pub(super) fn cancel(&self, callback: usize) -> bool {
        self.table.lock().unset(callback)
    }

    pub(super) fn is_set(&self, callback: usize) -> bool {
        self.table.lock().entries[callback].wish.is_some()
    }

    /// Its handle is gone.
    pub(super) fn release(&self, callback: usize) {
        let mut table = self.table.lock();
        table.unset(callback);
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
        for entry in &mut table.entries {
            entry.enter(start, engine);
        }
    }

    /// Calls a callback at its deadline, unless it was cancelled or set anew since; passes
    /// its panic with its name to `on_panic`. Manager's thread alone.
    pub(super) fn call(
        &self,
        callback: usize,
        engine: &Engine,
        on_panic: impl FnOnce(String, String),
    ) {
        let now = Instant::now();
        let mut table = self.table.lock();
        let entry = &mut table.entries[callback];
        let Some((firing, mut function)) = entry.take_due(now, engine).zip(entry.function.take())
        else {
            return;
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
            let message = luna_core::panic_message(&*payload);
            // Its drop is the user's code too.
            std::mem::forget(payload);
            table = self.table.lock();
            table.unset(callback);
            let counted = &mut table.entries[callback].counted;
            counted.panicked = true;
            let name = counted.name.clone();
            drop(table);
            on_panic(name, message);
        }
        table = self.table.lock();
        let entry = &mut table.entries[callback];
        // Half of a core at most for one that is always late.
        entry.rests_until = ended + taken.max(BUDGET);
        entry.was_called(function, firing, taken, turn, engine);
        if entry.is_gone {
            // Its function is dropped by the next user of the place, or at the end: not here, on
            // the path.
            table.free.push(callback);
        }
    }

    /// Stops all calls, and drops the functions. Not for the real-time path.
    pub(super) fn end(&self) {
        let mut functions = Vec::new();
        let mut table = self.table.lock();
        table.has_ended = true;
        for callback in 0..table.entries.len() {
            table.unset(callback);
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
    }

    /// Takes it out of the queue. Returns whether it was set.
    fn unset(&mut self, callback: usize) -> bool {
        let entry = &mut self.entries[callback];
        entry.armed.disarm();
        entry.turn += 1;
        entry.wish.take().is_some()
    }
}

impl Entry {
    /// Arms one that was just set, with grids that count from `start`; nothing if it is not set.
    fn enter(&mut self, start: Instant, engine: &Engine) {
        match self.wish {
            None => return,
            Some(Wish::At(deadline)) => {
                self.deadline = deadline;
                self.number = 0;
            }
            Some(Wish::Every { period, phase }) => {
                let origin = start.plus_nanos(phase);
                // Before the grid begins the first is slot 1, as of a loop.
                self.number = Instant::now().nanos_since(origin) / period + 1;
                self.deadline = origin.plus_nanos(period.saturating_mul(self.number));
            }
        }
        self.arm(engine);
    }

    /// Arms it for its deadline. For an instant that has passed it waits until it has rested since
    /// its last call. Otherwise a callback that always sets itself to the past would be called
    /// without end, on a thread above all others, and before them.
    fn arm(&mut self, engine: &Engine) {
        let is_late = self.period().is_none()
            && self.deadline < self.rests_until
            && self.deadline <= Instant::now();
        let at = match is_late {
            true => self.rests_until,
            false => self.deadline,
        };
        self.armed.arm(&engine.queue, self.place, at);
    }

    /// Its argument for a call `now`, if its deadline has come.
    fn take_due(&mut self, now: Instant, engine: &Engine) -> Option<Firing> {
        if !self.armed.take_fired() {
            return None;
        }
        let mut missed = 0;
        if let Some(period) = self.period() {
            let late = now.nanos_since(self.deadline);
            engine.note_lateness(late);
            // The slot that lasts now.
            missed = late / period;
            self.number += missed;
            self.deadline = self.deadline.plus_nanos(period.saturating_mul(missed));
        } else {
            self.wish = None;
        }
        Some(Firing {
            number: self.number,
            deadline: self.deadline,
            lateness: now - self.deadline,
            missed,
        })
    }

    fn was_called(
        &mut self,
        function: Function,
        firing: Firing,
        taken: Duration,
        turn: u64,
        engine: &Engine,
    ) {
        self.is_called = false;
        self.function = Some(function);
        let counted = &mut self.counted;
        counted.calls += 1;
        counted.missed += firing.missed;
        counted.too_long += u64::from(taken > BUDGET);
        counted.longest = counted.longest.max(taken);
        counted.latest = counted.latest.max(firing.lateness);
        if self.is_gone {
            return;
        }
        if let Some(period) = self.period() {
            if self.turn == turn {
                self.number += 1;
                self.deadline = self.deadline.plus_nanos(period);
                self.arm(engine);
            }
        } else if self.armed.disarm() {
            // Set in the call, before the call's end was known.
            self.arm(engine);
        }
    }
}
