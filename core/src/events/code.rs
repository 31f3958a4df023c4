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
