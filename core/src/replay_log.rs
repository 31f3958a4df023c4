//! The replay log: the contract between the operations and the recorder. A recorded process reports
//! what is not determined, and a replayed one gets it back.
//!
//! A *branch log* belongs to a process, or to a branch of it in a parallel construct: a sequence of
//! operations. The operations of a branch log are counted, and the undetermined outcome of one is
//! an [`Event`] with its number. Where several branches compete, the event has a *stamp* too, taken
//! under the lock that decides: a replay executes these events in the order of their stamps.
//!
//! An awaited operation [enters](ReplayLog::enter) once, [leaves](ReplayLog::leave) once when it is
//! decided, and goes on when it is not [held](ReplayLog::hold) any more. An operation that is not
//! awaited makes a [call](ReplayLog::call), and leaves. None of this happens in a process that is
//! neither recorded nor replayed.

use crate::current;
use core::fmt;
use core::task::{Context, Poll};
use luna_platform::clock::Instant;
use luna_platform::sync::plain::{AtomicU64, Ordering};

/// The stamp that a partner gets from a process that is not recorded.
pub const OUTSIDER: u64 = u64::MAX;

/// The outcome of an operation, with its code in a replay log's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// It has succeeded.
    Done = 0,
    /// It has failed; the number is the kind of failure.
    Failed = 1,
    /// Its time ran out.
    TimedOut = 2,
    /// The number of the chosen guard, of the outcome, or of the observed state.
    Chosen = 3,
    /// The clock was read.
    Time = 4,
}

/// The meaning of recorded bytes, with its code in a replay log's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum About {
    /// Input from outside.
    Input = 5,
    /// Output to the outside: a replay has to produce the same.
    Output = 6,
    /// The input of a periodic loop's cycle.
    Cycle = 7,
    /// Input from outside to an operation that waits.
    Read = 11,
}

/// The outcome of an operation, with a number that belongs to it, and the stamp, if it has one: 0
/// is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// What happened.
    pub what: What,
    /// The failure, guard, or time.
    pub number: u64,
    /// Its place in the order of all stamped events.
    pub stamp: u64,
}

impl Event {
    /// A success.
    pub fn done(stamp: u64) -> Self {
        Self::new(What::Done, 0, stamp)
    }

    /// A failure.
    pub fn failed(number: u64) -> Self {
        Self::new(What::Failed, number, 0)
    }

    /// Any other.
    pub fn new(what: What, number: u64, stamp: u64) -> Self {
        Self {
            what,
            number,
            stamp,
        }
    }
}

/// How an operation is executed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// As usual, and its undetermined outcome is recorded.
    Record,
    /// As usual: its outcome is determined.
    Look,
    /// With this outcome.
    Given(Event),
}

/// The recorder or replayer of a process. Used on the process' thread alone, in its polls.
pub trait ReplayLog {
    /// An awaited operation begins, or is polled again before it was let in. Pending: it has to
    /// wait, and changes nothing yet.
    fn enter(&self, cx: &mut Context<'_>) -> Poll<Turn>;

    /// An operation that does not wait begins. `takes`: a success moves a value, so that it gets a
    /// stamp.
    fn call(&self, takes: bool) -> Turn;

    /// Whether the process is replayed.
    fn is_replay(&self) -> bool;

    /// The operation that was let in is decided. Later calls for the same one do nothing.
    fn leave(&self, event: Event);

    /// An operation is dropped undecided. It was let in, or else it may wait for that.
    fn abandon(&self, was_let_in: bool);

    /// Whether all other processes have executed what has the stamp of the operation that was let
    /// in.
    fn settle(&self, cx: &mut Context<'_>) -> Poll<()>;

    /// Whether the branch may go on after an operation.
    fn hold(&self, cx: &mut Context<'_>) -> Poll<()>;

    /// A stamp, if there has to be one: several compete, or the present operation takes one in any
    /// case. 0: none. Under the lock that decides.
    fn stamp(&self, several: bool) -> u64;

    /// The stamp of the present operation.
    fn own_stamp(&self) -> u64;

    /// Records these bytes, as the outcome of the operation that was let in, or else as a call of
    /// its own.
    fn put(&self, about: About, name: u32, bytes: &[u8]);

    /// Reads the recorded bytes; returns their number, or none if there are no such bytes.
    fn get(&self, about: About, name: u32, into: &mut [u8]) -> Option<usize>;

    /// The id of the branch log, unique; not 0.
    fn branch_log(&self) -> u32;

    /// The number of the process in its recording.
    fn process(&self) -> u32;

    /// The process does something that is not recorded, so a replay might differ without notice.
    fn outside(&self, construct: &'static str);

    /// The operation did not have the given outcome.
    fn differs(&self, what: &'static str);
}

/// Installs a process' replay log around each of its polls.
pub trait LogInstaller: Send + Sync {
    /// Calls `poll`, which polls the process' body, with the process' replay log. `Ready` also if
    /// the body is to be dropped where it waits.
    fn poll(
        &self,
        cx: &mut Context<'_>,
        poll: &mut dyn FnMut(&mut Context<'_>) -> Poll<()>,
    ) -> Poll<()>;

    /// The body has completed, and is about to be dropped.
    fn completed(&self);

    /// The body was dropped.
    fn end(&self);
}

impl fmt::Debug for dyn LogInstaller {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LogInstaller").finish_non_exhaustive()
    }
}

/// The time; in a process with a replay log, the recorded time.
#[cold]
pub fn now() -> Instant {
    /// Lets time advance also beyond the end of the recording.
    static BEYOND: AtomicU64 = AtomicU64::new(0);
    let leave = |now: u64| {
        current::replay_log(|log| log.leave(Event::new(What::Time, now, 0)));
        Instant::from_nanos(now)
    };
    match current::replay_log(|log| log.call(false)) {
        Some(Turn::Given(event)) => leave(event.number),
        Some(Turn::Look) => {
            let beyond = BEYOND.fetch_add(1_000_000, Ordering::Relaxed);
            Instant::from_nanos(Instant::now().as_nanos().saturating_add(beyond))
        }
        _ => leave(Instant::now().as_nanos()),
    }
}
