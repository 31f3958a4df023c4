//! What ends a link but the end of its file or channel.

use super::record::BadRecord;
use luna_core::FileError;
use std::fmt;
use std::io;
use std::time::Duration;
use thiserror::Error;

/// Why a link to a file cannot be made, or has ended.
///
/// A link's process fails with `luna::Error::External` of it. Making one
/// allocates nothing, so a link may fail on the real-time path.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum LinkError {
    /// The framing allows records of no bytes, or of more than 1 GiB.
    #[error("a framing has records of at most {most} bytes; give them 1 byte to 1 GiB")]
    Room {
        /// The most bytes of a record.
        most: usize,
    },
    /// The framing's prefix is too short for the length of its longest records.
    #[error(
        "a framing has records of up to {most} bytes, but its prefix can state {longest} at most; take a wider one"
    )]
    PrefixTooSmall {
        /// The most bytes of a record.
        most: usize,
        /// The greatest length that the prefix can hold.
        longest: u64,
    },
    /// The link was run without its `pre_run`, or a second time.
    #[error("a link runs once, after its pre_run: spawn it, or call both by hand")]
    NotPrepared,
    /// The file refuses to be read or written without waiting.
    #[error("the file cannot be set to fail rather than wait: {0}")]
    SetUp(OsError),
    /// A record is broken.
    #[error("{0}")]
    Record(#[from] BadRecord),
    /// Reading failed.
    #[error("reading failed: {0}")]
    Read(OsError),
    /// Writing failed.
    #[error("writing failed in record {record}, after {written} of its bytes: {error}")]
    Write {
        /// Which record it was, counted from 1: the first that did not get out whole.
        record: u64,
        /// How many of its bytes did, with those that frame it.
        written: usize,
        /// The system's error.
        error: OsError,
    },
    /// The file cannot be waited for.
    #[error("{0}")]
    Wait(#[source] FileError),
    /// The other side has hung up, or the device was unplugged.
    #[error("the other side has hung up, or the device was unplugged")]
    HungUp,
    /// Nothing could be written for so long.
    #[error("nothing could be written for {limit:?}: the other side does not read")]
    Stalled {
        /// How long was waited.
        limit: Duration,
    },
    /// The device did not answer for so long.
    #[error("no answer for {limit:?}")]
    Silent {
        /// How long was waited.
        limit: Duration,
    },
    /// There is no connection, and no more attempts are made.
    #[error("no connection after {attempts} attempts: {error}")]
    NotConnected {
        /// How many there were.
        attempts: u32,
        /// Why the last one failed.
        error: OsError,
    },
    /// No more attempts to connect are made, and the last one did not fail: it gave a connection
    /// that is of no use any more, or it was cancelled.
    #[error("no attempt to connect is left after {attempts}")]
    NoAttemptLeft {
        /// How many there were since the last useful connection.
        attempts: u32,
    },
}

impl LinkError {
    /// Whether writing failed because the other end of the pipe or connection is closed.
    pub fn is_far_end_closed(&self) -> bool {
        matches!(
            self,
            LinkError::Write { error, .. }
                if matches!(error.kind(), io::ErrorKind::BrokenPipe | io::ErrorKind::ConnectionReset)
        )
    }
}

/// The system's error, kept as its number.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct OsError {
    kind: io::ErrorKind,
    code: Option<i32>,
}

impl OsError {
    /// The kind of error.
    pub fn kind(&self) -> io::ErrorKind {
        self.kind
    }

    /// The system's number for it, if it came from there.
    pub fn code(&self) -> Option<i32> {
        self.code
    }
}

impl From<io::Error> for OsError {
    fn from(error: io::Error) -> Self {
        Self {
            kind: error.kind(),
            code: error.raw_os_error(),
        }
    }
}

impl fmt::Display for OsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.code {
            Some(code) => io::Error::from_raw_os_error(code).fmt(f),
            None => self.kind.fmt(f),
        }
    }
}

impl fmt::Debug for OsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "OsError({self})")
    }
}
