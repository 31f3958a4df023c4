//! What can be wrong with a recording, and with a replay.

use thiserror::Error;

/// Why a program cannot be recorded or replayed, or has not done in the replay what it did when it
/// was recorded.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The file cannot be written or read.
    #[error("replay log `{path}`: {message}")]
    File {
        /// Its path.
        path: String,
        /// The message of the system.
        message: String,
    },
    /// The file is to have the name of a recording of the logger.
    #[error(
        "replay log `{path}`: a replay log is a .replay; a .luna is a recording of the logger, which `System::log_to`, LUNA_LOG or `luna demo --log` makes"
    )]
    NameOfTheLogger {
        /// Its path.
        path: String,
    },
    /// The file is there, and would be lost; or another program writes it.
    #[error(
        "replay log `{path}`: it is there already, and would be lost; name another file, remove it, or say that it may be replaced (`System::replace_recordings`, `luna demo --replace`)"
    )]
    IsThere {
        /// Its path.
        path: String,
    },
    /// It is no replay log.
    #[error(
        "the file is no replay log (.replay): `System::record` or `luna demo --record` makes one"
    )]
    NoRecording,
    /// It is a recording of the logger.
    #[error(
        "the file is a recording of the logger (.luna), not a replay log (.replay): `luna scope` shows it, and `luna convert` converts it"
    )]
    OfTheLogger,
    /// It was written by another version, which has this number.
    #[error(
        "the replay log has version {0}, and this program reads version {VERSION} alone",
        VERSION = super::file::VERSION
    )]
    Version(u16),
    /// The bytes of a block are not those that were written.
    #[error(
        "the replay log is damaged in the block at byte {offset}: `Recording::salvage` keeps what comes before"
    )]
    Damaged {
        /// Where the block begins.
        offset: u64,
    },
    /// The file ends before the recording does.
    #[error(
        "the replay log ends at byte {offset}, before its end: `Recording::salvage` keeps what is there"
    )]
    Truncated {
        /// Where the block begins that is not whole, or missing.
        offset: u64,
    },
    /// It is a recording of another system, or of one with other processes.
    #[error("the replay log is of another program: it has {recorded}, and here is {found}")]
    OtherProgram {
        /// What the recording has.
        recorded: String,
        /// What is here in its place.
        found: String,
    },
    /// A recorded process did what a recording does not hold, so that a replay could differ
    /// unnoticed.
    #[error(
        "process `{process}` did what is not recorded: {construct}; docs/record-and-replay.md says what to do instead"
    )]
    Outside {
        /// The process.
        process: String,
        /// What it did.
        construct: String,
    },
    /// The replay has come to something else than the recording.
    #[error("{0}")]
    Diverged(Box<Divergence>),
}

/// The first difference between a recording and its replay.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "the replay differs from the recording after {event} events: process `{process}`, operation {operation}{}: \
     recorded is {expected}, and now it is {found}",
    .output.map_or_else(String::new, |output| format!(", output {output}"))
)]
#[non_exhaustive]
pub struct Divergence {
    /// How many events had come again before.
    pub event: u64,
    /// The process.
    pub process: String,
    /// Which of its operations, counted from 1; those of a branch of a parallel construct are
    /// counted on their own.
    pub operation: u64,
    /// Which of its outputs it is, counted from 1, if it is one.
    pub output: Option<u64>,
    /// What the recording has.
    pub expected: String,
    /// What the replay has come to.
    pub found: String,
}
