//! What a recorded process tells of the things that nobody could foresee, and a replayed one is told: the contract between the operations and who
//! records.
//!
//! A *branch_log* is a process, or a branch of it in a parallel construct: what happens one after the other. Operations of a branch_log are counted, and what
//! cannot be foreseen of one is an [`Event`] that bears its number. Where several compete, the event bears a *stamp* too, taken under the lock that decides: a
//! replay does these events in the order of their stamps.
//!
//! An operation that is awaited [enters](ReplayLog::enter) once, [leaves](ReplayLog::leave) once when it is decided, and goes on when it is not [held](ReplayLog::hold) any more. One that is
//! not awaited makes a [call](ReplayLog::call), and leaves. Nothing of this happens in a process that is neither recorded nor replayed.

use crate::current;
use luna_platform::clock::Instant;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll};

/// The stamp that who is not recorded gives its partner.
pub const OUTSIDER: u64 = u64::MAX;

/// What an operation has come to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// It has succeeded.
    Done,
    /// It has failed, in the way that the number says.
    Failed,
    /// Its time ran out.
    TimedOut,
    /// The guard of this number was chosen, or it came to the outcome of this number, or this is what was seen.
    Chosen,
    /// The clock was read.
    Time,
}

/// What noted bytes are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum About {
    /// What was taken from outside.
    Input,
    /// What was given to the outside: the same is to be given again.
    Output,
    /// What a periodic loop was told.
    Cycle,
    /// What an operation that waits took from outside.
    Read,
}

/// What an operation has come to, with a number that belongs to it, and the stamp, if it has one: 0 is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// What happened.
    pub what: What,
    /// Which failure, guard, or time.
    pub number: u64,
    /// Its place among all that has one.
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

/// How an operation is to be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// As ever, and what cannot be foreseen of it is told.
    Record,
    /// As ever: there is nothing about it that could not be foreseen.
    Look,
    /// So that it comes to this.
    Given(Event),
}

/// Who records or replays a process. Used on the process' thread alone, in its polls.
pub trait ReplayLog {
    /// An awaited operation begins, or is polled again before it was let in. Pending: it is to wait, and changes nothing yet.
    fn enter(&self, cx: &mut Context<'_>) -> Poll<Turn>;

    /// An operation that does not wait begins. `takes` says that a success takes or gives something, so that it gets a stamp.
    fn call(&self, takes: bool) -> Turn;

    /// Whether the process is replayed.
    fn is_replay(&self) -> bool;

    /// The operation that was let in is decided. Later calls for the same one do nothing.
    fn leave(&self, event: Event);

    /// The operation that was let in is dropped undecided.
    fn abandon(&self);

    /// Whether all have done what bears the stamp of the operation that was let in, but for this one.
    fn settle(&self, cx: &mut Context<'_>) -> Poll<()>;

    /// Whether the branch_log may go on after an operation.
    fn hold(&self, cx: &mut Context<'_>) -> Poll<()>;

    /// Which guard an alternative that was let in is to choose.
    fn choice(&self) -> Option<u32>;

    /// Gives a stamp, if there has to be one: several compete, or the present operation takes one in any case. 0: none. Under the lock that decides.
    fn stamp(&self, several: bool) -> u64;

    /// The stamp that the present operation has taken.
    fn own_stamp(&self) -> u64;

    /// Notes these bytes, as what the operation that was let in has come to, or else as a call of its own.
    fn put(&self, about: About, name: u32, bytes: &[u8]);

    /// Gives the bytes that were noted, so many of them; none if there are no such ones.
    fn get(&self, about: About, name: u32, into: &mut [u8]) -> Option<usize>;

    /// A number of the branch_log, which no other one has; not 0.
    fn branch_log(&self) -> u32;

    /// The number of the process in its recording.
    fn process(&self) -> u32;

    /// The process does something that is not recorded, so that a replay might differ and nobody would know.
    fn outside(&self, construct: &'static str);

    /// The operation did not come to what it was given.
    fn differs(&self, what: &'static str);
}

/// Who puts a process' tape in around each of its polls.
pub trait Taper: Send + Sync {
    /// Calls `poll`, which polls the process' body, with the process' tape; `Ready`, too, if the body is to be dropped where it waits.
    fn poll(
        &self,
        cx: &mut Context<'_>,
        poll: &mut dyn FnMut(&mut Context<'_>) -> Poll<()>,
    ) -> Poll<()>;

    /// The body is gone.
    fn end(&self);
}

impl fmt::Debug for dyn Taper {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Taper").finish_non_exhaustive()
    }
}

/// The time, in a process with a tape: what it was.
#[cold]
pub fn now() -> Instant {
    /// So that time goes on also where the recording does not.
    static BEYOND: AtomicU64 = AtomicU64::new(0);
    let leave = |now: u64| {
        current::tape(|tape| tape.leave(Event::new(What::Time, now, 0)));
        Instant::from_nanos(now)
    };
    match current::tape(|tape| tape.call(false)) {
        Some(Turn::Given(event)) => leave(event.number),
        Some(Turn::Look) => {
            let beyond = BEYOND.fetch_add(1_000_000, Ordering::Relaxed);
            Instant::from_nanos(Instant::now().as_nanos().saturating_add(beyond))
        }
        _ => leave(Instant::now().as_nanos()),
    }
}
