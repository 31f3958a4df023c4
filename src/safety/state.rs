//! How safe the machine is, as far as it was reported: normal, warned of, in a safe state, in an
//! emergency. Latched: it only gets worse, until it is reset.

use crate::error::Error;
use crate::log::Log;
use luna_core::current::{self, ProcessId};
use luna_events::code;
use luna_machine::signals;
use luna_platform::clock::Instant;
use luna_platform::lock::PiLock;
use std::fmt;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, OnceLock};

/// How many events of a system are kept.
const KEPT: usize = 64;

/// How bad it is. Each is worse than the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum Degree {
    /// Nothing was reported.
    #[default]
    Normal,
    /// There is a warning. Everything goes on.
    Warning,
    /// All keeps running, and puts out what is neutral: processes ask
    /// [`is_safe_state`](crate::safety::Safety::is_safe_state).
    SafeState,
    /// The emergency functions have run, or do; the system ends.
    Emergency,
}

impl Degree {
    fn of(number: u32) -> Self {
        match number {
            0 => Degree::Normal,
            1 => Degree::Warning,
            2 => Degree::SafeState,
            _ => Degree::Emergency,
        }
    }
}

impl fmt::Display for Degree {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Degree::Normal => "normal",
            Degree::Warning => "warning",
            Degree::SafeState => "safe state",
            Degree::Emergency => "emergency",
        })
    }
}

/// Why.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Cause {
    /// The program raised it: [`luna::emergency`](crate::emergency()),
    /// [`Safety::raise`](crate::safety::Safety::raise),
    /// [`Safety::warn`](crate::safety::Safety::warn) and the like.
    Raised(Error),
    /// A process, a timer's callback or a thread of the framework panicked.
    Panic,
    /// A process overran a budget.
    Overrun,
    /// Every process of a strict system waits for another.
    Deadlock,
    /// A signal came that asks the program to end (SIGINT is 2, SIGTERM 15, SIGHUP 1), or another
    /// signal that ends a program by default.
    Signal(i32),
    /// The program that started this one has ended.
    ParentDied,
    /// The guardian has ended: nothing would bring the machine to safety if this program were
    /// killed.
    GuardianLost,
    /// It was reset, for this reason.
    Reset(Error),
}

impl Cause {
    /// The signal by which somebody stopped the program: SIGINT (Ctrl-C), SIGTERM or SIGHUP.
    fn stop(&self) -> Option<i32> {
        match self {
            Cause::Signal(number @ (1 | 2 | 15)) => Some(*number),
            _ => None,
        }
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Cause::Raised(error) => error.fmt(f),
            Cause::Panic => f.write_str("a panic"),
            Cause::Overrun => f.write_str("a budget was overrun"),
            Cause::Deadlock => f.write_str("a deadlock"),
            Cause::Signal(number) => signals::name(*number).fmt(f),
            Cause::ParentDied => f.write_str("the parent process has died"),
            Cause::GuardianLost => f.write_str("the guardian has ended"),
            Cause::Reset(why) => write!(f, "reset: {why}"),
        }
    }
}

/// The state changed, or the same degree was reported again.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct SafetyEvent {
    /// The degree that was reported.
    pub degree: Degree,
    /// Why.
    pub cause: Cause,
    /// The process that reported it; none if it was a plain thread, the framework, or something
    /// outside of the system.
    pub process: Option<ProcessId>,
    /// That process' name, if it is still known.
    pub who: Option<String>,
    /// When, on the clock of the reporting thread.
    pub at: Instant,
}

impl SafetyEvent {
    /// Reported now, by the current process if there is one.
    fn now(degree: Degree, cause: Cause) -> Self {
        Self {
            degree,
            cause,
            process: current::process(|process| process.map(|process| process.id())),
            who: None,
            at: Instant::now(),
        }
    }
}

impl fmt::Display for SafetyEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.cause.stop() {
            // The functions of an emergency run, but nothing is wrong.
            Some(number) => write!(f, "stopped by {}", signals::name(number))?,
            None => write!(f, "{}: {}", self.degree, self.cause)?,
        }
        match (&self.who, self.process) {
            (Some(name), _) => write!(f, ", by process `{name}`"),
            (None, Some(id)) => write!(f, ", by process {id}"),
            (None, None) => Ok(()),
        }
    }
}

/// How safe a system was at one instant, from its [handle](super::Safety).
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct SafetyState {
    /// How bad it is.
    pub degree: Degree,
    /// What made it so; none if it is normal.
    pub latched: Option<SafetyEvent>,
    /// All reports, in order: the first 64.
    pub events: Vec<SafetyEvent>,
    /// How many more there were.
    pub more_events: u64,
}

impl fmt::Display for SafetyState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.latched {
            Some(event) => event.fmt(f),
            None => self.degree.fmt(f),
        }
    }
}

/// Why the state was not reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ResetError {
    /// There is an emergency: the system ends, and a new one has to be made.
    #[error("an emergency cannot be reset: the system ends, make a new one")]
    Emergency,
    /// The functions of [`on_safe_state`](crate::System::on_safe_state) still run.
    #[error("the functions of the safe state still run: reset it when they have")]
    FunctionsRun,
}

/// The degree, in the lowest two bits, and above them how often a safe state was entered until
/// then. Both are in one word, so that two safe states are never taken for one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Level(u32);

impl Level {
    /// The bits of the degree.
    const DEGREE: u32 = 3;

    pub(super) fn degree(self) -> Degree {
        Degree::of(self.0 & Self::DEGREE)
    }

    fn at(self, degree: Degree) -> Self {
        Self(self.0 & !Self::DEGREE | degree as u32)
    }

    /// The level after a report of `degree`; nothing if it is that bad already.
    fn worsened(self, degree: Degree) -> Option<Self> {
        let entered = match degree {
            Degree::SafeState => Self(self.0.wrapping_add(Self::DEGREE + 1)),
            _ => self,
        };
        (degree > self.degree()).then(|| entered.at(degree))
    }
}

/// What was reported, and what is latched. A reader takes the lock for a few moves and never
/// allocates under it. So a report on the real-time path waits for no reader's memory.
#[derive(Debug)]
pub(crate) struct Journal {
    /// A [`Level`].
    level: AtomicU32,
    /// The places of the first events.
    kept: Box<[Place]>,
    book: PiLock<Book>,
    /// The log that records changes.
    log: OnceLock<Log>,
    /// The levels that were recorded.
    #[cfg(test)]
    reported: std::sync::Mutex<Vec<Degree>>,
}

#[derive(Debug)]
struct Book {
    /// How many places of `kept` are written.
    kept: usize,
    more: u64,
    /// What made it a warning, a safe state and an emergency.
    latched: [Option<Place>; 3],
    /// For the latched events when those places are used up. New ones come with a reset, which is
    /// off the real-time path.
    apart: [Place; 3],
}

/// Written once, under the lock of the book, and then read without it.
type Place = Arc<OnceLock<SafetyEvent>>;

impl Book {
    /// Keeps an event, which is latched as `latches`. Returns it if there is no room.
    fn keep(
        &mut self,
        kept: &[Place],
        event: SafetyEvent,
        latches: Option<usize>,
    ) -> Option<SafetyEvent> {
        let place = match kept.get(self.kept) {
            Some(place) => {
                self.kept += 1;
                Some(place.clone())
            }
            None => {
                self.more += 1;
                latches.map(|slot| self.apart[slot].clone())
            }
        };
        if let Some(slot) = latches {
            self.latched[slot].clone_from(&place);
        }
        match place {
            // Only the lock's holder writes, each place once.
            Some(place) => place.set(event).err(),
            None => Some(event),
        }
    }
}

impl Journal {
    pub(crate) fn new() -> Self {
        Self {
            level: AtomicU32::new(Degree::Normal as u32),
            kept: (0..KEPT).map(|_| Place::default()).collect(),
            book: PiLock::new(Book {
                kept: 0,
                more: 0,
                latched: Default::default(),
                apart: Default::default(),
            }),
            log: OnceLock::new(),
            #[cfg(test)]
            reported: std::sync::Mutex::default(),
        }
    }

    /// From now on changes are recorded in `log`.
    pub(crate) fn record(&self, log: Log) {
        // A system is started once.
        let _ = self.log.set(log);
    }

    /// Records the new degree. The book is locked meanwhile, so that the last record is the current
    /// degree. Recording is wait-free, except on a thread without a ring: there it takes a lock
    /// that is held for a few moves, and under which no other lock is taken.
    /// `stop` is the signal that asked for an end, 0 if none did.
    fn report(&self, _: &Book, degree: Degree, process: Option<ProcessId>, stop: u64) {
        #[cfg(test)]
        self.reported.lock().unwrap().push(degree);
        if let Some(log) = self.log.get() {
            // 0: from outside of processes.
            let of = process.map_or(0, ProcessId::get);
            log.report(code::EMERGENCY, of, [degree as u64, stop]);
        }
    }

    pub(crate) fn degree(&self) -> Degree {
        self.level().degree()
    }

    pub(super) fn level(&self) -> Level {
        Level(self.level.load(Ordering::Acquire))
    }

    /// Notes a report. If the state was not that bad before, `admit` is asked first, so that no
    /// reset comes in between; without its consent nothing is noted. O(1); no allocation: the cause
    /// is moved to its place.
    pub(crate) fn note(&self, degree: Degree, cause: Cause, admit: impl FnOnce() -> bool) {
        let event = SafetyEvent::now(degree, cause);
        let mut changes = false;
        let by = event.process;
        let stop = event.cause.stop().map_or(0, i32::unsigned_abs).into();
        // After the event is made: an event that is not kept is user data, and dropped without the
        // lock.
        let mut book = self.book.lock();
        let emergency = book.latched[2].as_ref().and_then(|place| place.get());
        if matches!(event.cause, Cause::Signal(_))
            && emergency.is_some_and(|latched| latched.cause == event.cause)
        {
            // Another worker has received it just before.
            return;
        }
        if degree > self.degree() {
            if !admit() {
                return;
            }
            self.worsen(degree);
            changes = true;
        }
        let latches = (degree as usize)
            .checked_sub(1)
            .filter(|&slot| book.latched[slot].is_none());
        let left = book.keep(&self.kept, event, latches);
        // A crash has made it that bad before it is noted here.
        if changes || latches.is_some() && degree >= self.degree() {
            self.report(&book, degree, by, stop);
        }
        drop(book);
        drop(left);
    }

    /// It is that bad at least. Without the lock.
    pub(super) fn worsen(&self, degree: Degree) {
        // If this fails, it is that bad already.
        let _ = self
            .level
            .fetch_update(Ordering::AcqRel, Ordering::Acquire, |level| {
                Level(level).worsened(degree).map(|level| level.0)
            });
    }

    /// What made it an emergency.
    pub(crate) fn emergency(&self) -> Option<SafetyEvent> {
        let latched = self.book.lock().latched[2].clone();
        latched?.get().cloned()
    }

    pub(super) fn reset(&self, why: Error, may: impl FnOnce() -> bool) -> Result<(), ResetError> {
        let event = SafetyEvent::now(Degree::Normal, Cause::Reset(why));
        let new_places = Default::default();
        let mut book = self.book.lock();
        if self.degree() == Degree::Emergency {
            return Err(ResetError::Emergency);
        }
        if !may() {
            return Err(ResetError::FunctionsRun);
        }
        // The lock is held, so only a crash can make the state worse meanwhile.
        let reset = self
            .level
            .fetch_update(Ordering::AcqRel, Ordering::Acquire, |level| {
                let level = Level(level);
                (level.degree() != Degree::Emergency).then(|| level.at(Degree::Normal).0)
            });
        if reset.is_err() {
            return Err(ResetError::Emergency);
        }
        let former = (
            std::mem::take(&mut book.latched),
            std::mem::replace(&mut book.apart, new_places),
        );
        let by = event.process;
        let left = book.keep(&self.kept, event, None);
        self.report(&book, Degree::Normal, by, 0);
        drop(book);
        drop((former, left));
        Ok(())
    }

    pub(super) fn state(&self) -> SafetyState {
        let (degree, kept, more_events, latched) = {
            let book = self.book.lock();
            let degree = self.degree();
            let slot = (degree as usize).checked_sub(1);
            let latched = slot.and_then(|slot| book.latched[slot].clone());
            (degree, book.kept, book.more, latched)
        };
        let events = self.kept[..kept].iter().filter_map(|place| place.get());
        SafetyState {
            degree,
            latched: latched.and_then(|latched| latched.get().cloned()),
            events: events.cloned().collect(),
            more_events,
        }
    }
}

#[cfg(test)]
mod tests;
