//! Events of the processes of a thread: the contract between the operations and a logger.
//!
//! A thread that is traced has a ring, made before it runs processes (`attach`). An operation
//! [reports](report) an event by its code, its subject and two numbers; a time stamp is added. The
//! logger's documentation describes the events.
//!
//! Without the feature `events` this costs no code and no memory. With it, a thread that is not
//! traced executes one predictable branch for each event. On the fast path there is a single one,
//! when an operation that has waited goes on. Turns, wakes and communications within one executor
//! use separate functions in a [traced](crate::current::Process::set_traced) process; bytes
//! that are read anyway select them.
//!
//! The other half are names: the code that makes a process, a channel or a loop [names](name) it,
//! if there is a listener (`listen`). Not for the real-time path, as making one is not.

pub mod code;
mod reports;
#[cfg(any(all(feature = "events", not(loom)), all(test, loom)))]
mod ring;
mod waits;

// Models check the ring alone, not the events.
#[cfg(all(feature = "events", not(loom)))]
mod names;
#[cfg(not(all(feature = "events", not(loom))))]
#[path = "off.rs"]
mod thread;
#[cfg(all(feature = "events", not(loom)))]
#[path = "on.rs"]
mod thread;
#[cfg(all(feature = "events", not(loom)))]
mod waits_in;

pub use reports::*;
#[cfg(all(feature = "events", not(loom)))]
pub use ring::{Losses, Reader, Writer, ring};
pub use thread::*;
pub use waits::{beside, waits_for, waits_for_other, waits_for_several, waits_no_more};

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
