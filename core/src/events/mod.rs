//! Events of the processes of a thread: what the kernel tells the one that traces them.
//!
//! A thread that is traced has a [`Trace`], given to it before it runs processes ([`attach`]). An
//! operation [reports](report) an event by its code, its subject and two numbers. The kernel keeps
//! none of them: rings, names and time stamps are of `luna-events`, whose documentation describes
//! the events.
//!
//! Without the feature `events` this costs no code and no memory. With it, a thread that is not
//! traced executes one predictable branch for each event. On the fast path there is a single one,
//! when an operation that has waited goes on. Turns, wakes and communications within one executor
//! use separate functions in a traced process; bytes
//! that are read anyway select them.
//!
//! The other half are names: the code that makes a process, a channel or a loop [names](name) it,
//! if something listens ([`listen`]). Not for the real-time path, as making one is not.

pub mod code;
mod reports;
#[cfg_attr(
    not(all(feature = "events", not(loom))),
    allow(dead_code, unreachable_pub, reason = "no thread is traced")
)]
mod trace;
mod waits;

pub use reports::*;
pub use trace::{Kept, is_on, name, name_executor, name_process, place};
#[cfg(all(feature = "events", not(loom)))]
pub use trace::{Listening, Namer, Trace, attach, detach, listen};
pub use waits::{beside, of_part, waits_for, waits_for_other, waits_for_several, waits_no_more};

/// The kind of a numbered object in an event; as a byte, its code in a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Kind {
    /// A process.
    Process = 1,
    /// An executor, or the thread of a process that has one of its own.
    Executor = 2,
    /// A channel.
    Channel = 3,
    /// A barrier.
    Barrier = 4,
    /// A mutex, a condition or a semaphore.
    Lock = 5,
    /// A periodic loop.
    Loop = 6,
    /// A named part of a process. 7 is a kind of event.
    SubProcess = 8,
}
