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

#[cfg_attr(
    not(all(feature = "events", not(loom))),
    allow(dead_code, unreachable_pub, reason = "no thread is traced")
)]
mod trace;
mod waits;

pub use trace::{Kept, is_on, name, name_executor, name_process, place};
#[cfg(all(feature = "events", not(loom)))]
pub use trace::{Listening, Namer, Trace, attach, detach, listen};
pub use waits::{beside, of_part, waits_for, waits_for_other, waits_for_several, waits_no_more};

use crate::current::{self, User};
use trace::put;

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

pub mod code {
    //! What the kernel reports. `docs/events.md` says what the subjects and numbers of events are.

    /// A process has become ready.
    pub const READY: u16 = 1;
    /// A process' turn begins.
    pub const RUNNING: u16 = 2;
    /// A process' turn ends, and it waits, or is ready again.
    pub const WAITING: u16 = 3;
    /// A process has ended.
    pub const DONE: u16 = 4;
    /// A value has gone through a channel.
    pub const COMMUNICATION: u16 = 5;
    /// An alternative has chosen.
    pub const ALTERNATIVE: u16 = 6;
    /// An executor sleeps.
    pub const ASLEEP: u16 = 7;
    /// An executor works again.
    pub const AWAKE: u16 = 8;
    /// A process has another priority.
    pub const PRIORITY: u16 = 9;
    /// A process was spawned.
    pub const SPAWNED: u16 = 13;

    /// In [`WAITING`]: what it waits for is not known, or is several things.
    pub const WAITS_UNKNOWN: u64 = 0;
    /// In [`WAITING`]: it is ready again, and has only let others run.
    pub const STILL_READY: u64 = 255;

    /// In [`DONE`]: how a process has ended.
    pub mod ended {
        /// Its body returned `Ok`.
        pub const OK: u64 = 0;
        /// Its body returned an error, or the framework found one in it.
        pub const ERROR: u64 = 1;
        /// It panicked.
        pub const PANICKED: u64 = 2;
        /// It was cancelled.
        pub const CANCELLED: u64 = 3;
    }
}

/// Reports an event of the calling thread, if the thread is traced. Real-time path: yes;
/// wait-free, O(1).
#[inline(always)]
pub fn report(of: u16, subject: u32, arguments: impl FnOnce() -> [u64; 2]) {
    if is_on() {
        report_now(of, subject, arguments());
    }
}

#[cold]
#[inline(never)]
fn report_now(of: u16, subject: u32, arguments: [u64; 2]) {
    put(of, subject, arguments);
}

/// Reports that a process of the calling thread has become ready, and the current process as the
/// one that readied it.
#[inline(always)]
pub fn ready(process: impl FnOnce() -> u32) {
    if is_on() {
        report_ready(process());
    }
}

#[cold]
#[inline(never)]
fn report_ready(process: u32) {
    put(code::READY, process, [current_process(), 0]);
}

/// Reports that the turn of a process begins.
#[inline]
pub fn begin_turn(process: u32) {
    if is_on() {
        waits::clear();
        put(code::RUNNING, process, [0, 0]);
    }
}

/// Reports that the turn of a process ends and the process goes on; `is_ready`: it is ready again
/// already, else it waits.
#[inline]
pub fn end_turn(process: u32, is_ready: bool) {
    if is_on() {
        let arguments = match is_ready {
            true => [code::STILL_READY, 0],
            false => waits::arguments(),
        };
        put(code::WAITING, process, arguments);
    }
}

/// Notes that the body of the current process has returned an error: for [`done`].
#[inline]
pub fn note_failure() {
    if is_on() {
        waits::fail();
    }
}

/// Reports that a process has ended; `how` is one of [`code::ended`]. A noted error takes
/// precedence.
#[inline]
pub fn done(process: u32, how: u64) {
    if is_on() {
        let has_failed = how == code::ended::OK && waits::has_failed();
        put(
            code::DONE,
            process,
            [if has_failed { code::ended::ERROR } else { how }, 0],
        );
    }
}

/// The number of the current process; 0 if there is none.
pub fn current_process() -> u64 {
    match current::user() {
        User::Process(id) => id.get().into(),
        User::Outside => 0,
    }
}

/// Reports that the executor of the calling thread sleeps, or is awake.
#[inline]
pub fn report_executor(of: u16) {
    if let Some((_, number)) = place() {
        put(of, number, [0, 0]);
    }
}
