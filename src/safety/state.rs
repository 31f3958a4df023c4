//! How safe the machine is, as far as anybody has said: normal, warned of, in a safe state, in an emergency. Latched: it only gets worse, until somebody resets it.

use crate::error::Error;
use crate::logging::Log;
use luna_platform::clock::Instant;
use luna_platform::current::{self, ProcessId};
use luna_platform::lock::PiLock;
use std::fmt;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, Ordering};

/// How many events of a system are kept.
const KEPT: usize = 64;

/// How bad it is. Each is worse than the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum Degree {
    /// Nobody has said anything.
    #[default]
    Normal,
    /// Somebody has warned. Everything goes on.
    Warning,
    /// All keeps running, and puts out what is neutral: processes ask [`is_safe_state`](crate::Safety::is_safe_state).
    SafeState,
    /// The emergency functions have run, or do; the system ends.
    Emergency,
}

impl Degree {
    fn of(number: u8) -> Self {
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
    /// Somebody said so: [`luna::emergency`](crate::emergency()), [`EmergencyTrigger::raise`](crate::EmergencyTrigger::raise), [`Safety::warn`](crate::Safety::warn) and the like.
    Raised(Error),
    /// A process, a timer's callback or a thread of the framework panicked.
    Panic,
    /// A process overran a budget.
    Overrun,
    /// Every process of a strict system waits for another.
    Deadlock,
    /// A signal came that asks the program to end (SIGINT is 2, SIGTERM 15, SIGHUP 1), or one that says that it crashes.
    Signal(i32),
    /// The program that started this one has ended.
    ParentDied,
    /// The guardian has ended: nobody would do anything if this program were killed.
    GuardianLost,
    /// Somebody has reset it, for this reason.
    Reset(Error),
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Cause::Raised(error) => error.fmt(f),
            Cause::Panic => f.write_str("a panic"),
            Cause::Overrun => f.write_str("a budget was overrun"),
            Cause::Deadlock => f.write_str("a deadlock"),
            Cause::Signal(2) => f.write_str("SIGINT"),
            Cause::Signal(15) => f.write_str("SIGTERM"),
            Cause::Signal(1) => f.write_str("SIGHUP"),
            Cause::Signal(number) => write!(f, "signal {number}"),
            Cause::ParentDied => f.write_str("the parent process has died"),
            Cause::GuardianLost => f.write_str("the guardian has ended"),
            Cause::Reset(why) => write!(f, "reset: {why}"),
        }
    }
}

/// That the state changed, or that somebody said so again.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct SafetyEvent {
    /// What was said: how bad it is.
    pub degree: Degree,
    /// Why.
    pub cause: Cause,
    /// The process that said so; none if it was a plain thread, the framework, or the system outside.
    pub process: Option<ProcessId>,
    /// That process' name, if it is still known.
    pub who: Option<String>,
    /// When, on the clock of who said so.
    pub at: Instant,
}

impl fmt::Display for SafetyEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.degree, self.cause)?;
        match (&self.who, self.process) {
            (Some(name), _) => write!(f, ", by process `{name}`"),
            (None, Some(id)) => write!(f, ", by process {id}"),
            (None, None) => Ok(()),
        }
    }
}

/// How safe a system was at one instant, from its [handle](crate::Safety).
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct SafetyState {
    /// How bad it is.
    pub degree: Degree,
    /// What made it so; none if it is normal.
    pub latched: Option<SafetyEvent>,
    /// All that was said, in this order: the first 64.
    pub events: Vec<SafetyEvent>,
    /// How much more was said.
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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ResetError {
    /// There is an emergency: the system ends, and is made anew.
    Emergency,
    /// The functions of [`on_safe_state`](crate::System::on_safe_state) still run.
    FunctionsRun,
}

impl fmt::Display for ResetError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ResetError::Emergency => {
                "an emergency cannot be reset: the system ends, make a new one"
            }
            ResetError::FunctionsRun => {
                "the functions of the safe state still run: reset it when they have"
            }
        })
    }
}

impl std::error::Error for ResetError {}

/// What was said, and what is latched.
#[derive(Debug)]
pub(crate) struct Journal {
    degree: AtomicU8,
    book: PiLock<Book>,
    /// Who records that it changes.
    log: OnceLock<Log>,
}

#[derive(Debug)]
struct Book {
    events: Vec<SafetyEvent>,
    more: u64,
    /// What made it a warning, a safe state and an emergency.
    latched: [Option<SafetyEvent>; 3],
}

impl Journal {
    pub(crate) fn new() -> Self {
        Self {
            degree: AtomicU8::new(Degree::Normal as u8),
            book: PiLock::new(Book {
                events: Vec::with_capacity(KEPT),
                more: 0,
                latched: [const { None }; 3],
            }),
            log: OnceLock::new(),
        }
    }

    /// From now on this records that it changes.
    pub(crate) fn record(&self, log: Log) {
        // A system is started once.
        let _ = self.log.set(log);
    }

    fn tell(&self, degree: Degree, process: Option<ProcessId>) {
        if let Some(log) = self.log.get() {
            log.tell_safety(process.map_or(0, ProcessId::get), degree as u8);
        }
    }

    pub(crate) fn degree(&self) -> Degree {
        Degree::of(self.degree.load(Ordering::Acquire))
    }

    /// Notes that somebody said so. If it was not that bad before, `admit` is asked first, so that no reset comes in between; without its consent nothing is noted.
    /// O(1); no allocation but the clones of what the cause holds.
    pub(crate) fn note(
        &self,
        degree: Degree,
        cause: Cause,
        at: Instant,
        admit: impl FnOnce() -> bool,
    ) {
        let event = SafetyEvent {
            degree,
            cause,
            process: current::process(|process| process.map(|process| process.id())),
            who: None,
            at,
        };
        let mut latched = Some(event.clone());
        let mut changes = false;
        let by = event.process;
        // Behind those: what is not kept is the user's, and dropped without the lock.
        let mut book = self.book.lock();
        if matches!(event.cause, Cause::Signal(_))
            && book.latched[2]
                .as_ref()
                .is_some_and(|latched| latched.cause == event.cause)
        {
            // Another member of the crew has heard of it just before.
            return;
        }
        if degree > self.degree() {
            if !admit() {
                return;
            }
            self.worsen(degree);
            changes = true;
        }
        if let Some(slot) = (degree as usize).checked_sub(1)
            && book.latched[slot].is_none()
        {
            book.latched[slot] = latched.take();
        }
        let surplus = book.keep(event);
        drop(book);
        if changes {
            self.tell(degree, by);
        }
        drop(surplus);
    }

    /// It is that bad at least. Without the lock.
    pub(super) fn worsen(&self, degree: Degree) {
        self.degree.fetch_max(degree as u8, Ordering::AcqRel);
    }

    /// What made it an emergency.
    pub(crate) fn emergency(&self) -> Option<SafetyEvent> {
        self.book.lock().latched[2].clone()
    }

    pub(super) fn reset(&self, why: Error, may: impl FnOnce() -> bool) -> Result<(), ResetError> {
        let event = SafetyEvent {
            degree: Degree::Normal,
            cause: Cause::Reset(why),
            process: current::process(|process| process.map(|process| process.id())),
            who: None,
            at: Instant::now(),
        };
        let mut book = self.book.lock();
        if self.degree() == Degree::Emergency {
            return Err(ResetError::Emergency);
        }
        if !may() {
            return Err(ResetError::FunctionsRun);
        }
        // Under the lock nobody makes it worse meanwhile, but a crash.
        let reset = self
            .degree
            .fetch_update(Ordering::AcqRel, Ordering::Acquire, |degree| {
                (Degree::of(degree) != Degree::Emergency).then_some(Degree::Normal as u8)
            });
        if reset.is_err() {
            return Err(ResetError::Emergency);
        }
        let before = std::mem::replace(&mut book.latched, [const { None }; 3]);
        let by = event.process;
        let surplus = book.keep(event);
        drop(book);
        self.tell(Degree::Normal, by);
        drop((before, surplus));
        Ok(())
    }

    pub(super) fn state(&self) -> SafetyState {
        // Allocated before the lock is taken; a cause may hold text of its own all the same.
        let mut events = Vec::with_capacity(KEPT);
        let book = self.book.lock();
        events.extend_from_slice(&book.events);
        let degree = self.degree();
        let latched = (degree as usize)
            .checked_sub(1)
            .and_then(|slot| book.latched[slot].clone());
        SafetyState {
            degree,
            latched,
            events,
            more_events: book.more,
        }
    }
}

impl Book {
    /// Gives it back if there is no room.
    #[must_use = "what is not kept is dropped without the lock"]
    fn keep(&mut self, event: SafetyEvent) -> Option<SafetyEvent> {
        // Room was set aside: nothing is allocated.
        if self.events.len() < KEPT {
            self.events.push(event);
            None
        } else {
            self.more += 1;
            Some(event)
        }
    }
}
