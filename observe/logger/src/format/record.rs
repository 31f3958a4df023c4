//! What a recording holds.

use super::types::{ClockBase, Level, Losing, Type, Values};

/// One record, which borrows from its block. Times are nanoseconds on the recording's clock.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Record<'a> {
    /// The recorded system: the first record, and again where a recorder had to start again. The
    /// declarations that follow repeat the earlier ones.
    Session {
        /// The system's name.
        system: &'a str,
        /// What times count from.
        clock: ClockBase,
        /// The version of the program that wrote it, as text.
        written_by: &'a str,
    },
    /// A thread that records.
    Thread {
        /// Its number in this recording.
        number: u32,
        /// Its name.
        name: &'a str,
    },
    /// A signal, before its first sample.
    Signal(SignalInfo<'a>),
    /// A sample of a signal.
    Sample {
        /// The signal's number.
        signal: u32,
        /// When.
        time: u64,
        /// The values of its elements.
        values: Values<'a>,
    },
    /// A message.
    Message {
        /// The number of the thread that wrote it.
        thread: u32,
        /// When.
        time: u64,
        /// How much it matters.
        level: Level,
        /// The process that wrote it, by number; 0 if none did.
        process: u32,
        /// Whether its end was cut off.
        truncated: bool,
        /// Where in the program it is from: a module path, mostly.
        target: &'a str,
        /// The text.
        text: &'a str,
    },
    /// A CSP event.
    Event(Event),
    /// A name for the numbers in events and messages.
    Name {
        /// The named subject.
        subject: Subject,
        /// Its number.
        number: u32,
        /// The number of its parent (a sub-process' or loop's process); 0 if it has none. Of a
        /// channel, what its buffer is: 0 if that is not known; else four times the capacity, and 1
        /// of a FIFO or a rendezvous, 2 of one that drops its oldest value, 3 of one that drops its
        /// newest.
        parent: u32,
        /// Its name.
        name: &'a str,
        /// For a process: where it runs, if known.
        runs_on: Option<RunsOn>,
    },
    /// The losses from the beginning of the recording until here.
    Losses {
        /// Of what.
        of: Losing,
        /// How many: never less than in the record before.
        lost: u64,
    },
    /// What the time of day was at an instant, from time to time.
    Epoch {
        /// The instant on the recording's clock.
        time: u64,
        /// Nanoseconds since 1970 in UTC at that instant.
        unix: i64,
    },
    /// The recording is whole: nothing follows.
    End {
        /// When it ended.
        time: u64,
    },
}

/// Where a process runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunsOn {
    /// The number of its executor, which is that of a thread of the recording.
    pub executor: u32,
    /// Its priority level there.
    pub level: u8,
}

/// What a signal is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SignalInfo<'a> {
    /// Its number in this recording, from 0.
    pub number: u32,
    /// The type of its elements.
    pub element_type: Type,
    /// How many elements a sample has: 1 for a scalar.
    pub elements: u8,
    /// Its name.
    pub name: &'a str,
    /// Its unit; empty if none was stated.
    pub unit: &'a str,
    /// What it is; empty if not stated.
    pub description: &'a str,
}

/// A CSP event: something that a process, or the framework, has done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// The number of the thread on which it happened.
    pub thread: u32,
    /// When, in nanoseconds on the recording's clock.
    pub time: u64,
    /// What happened: `docs/events.md` lists the codes. A reader shows unknown codes by number.
    pub code: u16,
    /// What did it: usually the number of a process.
    pub subject: u32,
    /// What it is about, by code: a channel, a partner, a guard, a level, nanoseconds.
    pub arguments: [u64; 2],
}

/// What a number in an event means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum Subject {
    /// A process.
    Process = 1,
    /// An executor.
    Executor = 2,
    /// A channel.
    Channel = 3,
    /// A barrier.
    Barrier = 4,
    /// A lock.
    Lock = 5,
    /// A periodic loop.
    Loop = 6,
    /// A kind of event.
    Code = 7,
    /// A named part of a process.
    SubProcess = 8,
}

impl Subject {
    pub(crate) fn from_byte(byte: u8) -> Option<Subject> {
        [
            Subject::Process,
            Subject::Executor,
            Subject::Channel,
            Subject::Barrier,
            Subject::Lock,
            Subject::Loop,
            Subject::Code,
            Subject::SubProcess,
        ]
        .into_iter()
        .find(|one| *one as u8 == byte)
    }
}
