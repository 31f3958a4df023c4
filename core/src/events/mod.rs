//! What the processes of a thread do, event by event, for who records it: the contract between the operations and a logger.
//!
//! A thread that is recorded has a ring, made before it runs processes (`attach`). Whoever does something worth an event [tells](tell) it, with the
//! event's code, its subject and two numbers; a time stamp is added. What an event means is said in the logger's documentation.
//!
//! Without the feature `events` all of this is nothing: no code, no memory. With it, a thread that is not recorded executes one branch an event, which is always the
//! same. Where it counts there is one, when an operation that has waited goes on, and no other: turns, wakes and what processes of one executor send each other go other ways in a process that is
//! [recorded](crate::current::Process::set_recorded), which bytes say that are looked at anyway.
//!
//! The other half are names: who makes a process, a channel or a loop [names](name) it, if anybody listens (`listen`). Not for the real-time path, as making one is not.

pub mod code;
#[cfg(any(all(feature = "events", not(loom)), all(test, loom)))]
mod ring;

// A model looks at no events, but at the ring.
#[cfg(all(feature = "events", not(loom)))]
mod names;
#[cfg(not(all(feature = "events", not(loom))))]
mod off;
#[cfg(all(feature = "events", not(loom)))]
mod on;
#[cfg(all(feature = "events", not(loom)))]
mod waits;

#[cfg(not(all(feature = "events", not(loom))))]
pub use off::*;
#[cfg(all(feature = "events", not(loom)))]
pub use on::*;

#[cfg(all(feature = "events", not(loom)))]
pub use ring::{Losses, Reader, Writer, ring};

/// What a number in an event means; as a byte, what a recording has for it.
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

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn each_code_has_one_name() {
        for (index, (number, name)) in code::NAMES.iter().enumerate() {
            assert_eq!(usize::from(*number), index + 1);
            assert!(!name.is_empty());
        }
    }
}
