//! What ends a link but the end of its file or channel.

use super::record::BadRecord;
use luna_executors::FileError;
use std::fmt;
use std::io;
use std::time::Duration;

/// Why a link to a file cannot be made, or has ended.
///
/// A link's process fails with [`Error::External`](crate::Error::External) of it. Making one
/// allocates nothing, so a link may fail on the real-time path.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum LinkError {
    /// The framing allows records of no bytes, or of more than 1 GiB.
    Room {
        /// The most bytes of a record.
        most: usize,
    },
    /// The framing's prefix is too short for the length of its longest records.
    PrefixTooSmall {
        /// The most bytes of a record.
        most: usize,
        /// The greatest length that the prefix can hold.
        longest: u64,
    },
    /// The link was run without its `pre_run`, or a second time.
    NotPrepared,
    /// The file refuses to be read or written without waiting.
    SetUp(OsError),
    /// A record is broken.
    Record(BadRecord),
    /// Reading failed.
    Read(OsError),
    /// Writing failed.
    Write {
        /// Which record it was, counted from 1: the first that did not get out whole.
        record: u64,
        /// How many of its bytes did, with those that frame it.
        written: usize,
        /// The system's error.
        error: OsError,
    },
    /// The file cannot be waited for.
    Wait(FileError),
    /// The other side has hung up, or the device was unplugged.
    HungUp,
    /// Nothing could be written for so long.
    Stalled {
        /// How long was waited.
        limit: Duration,
    },
    /// The device did not answer for so long.
    Silent {
        /// How long was waited.
        limit: Duration,
    },
    /// There is no connection, and no more attempts are made.
    NotConnected {
        /// How many there were.
        attempts: u32,
        /// Why the last one failed.
        error: OsError,
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

impl fmt::Display for LinkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LinkError::Room { most } => write!(
                f,
                "a framing has records of at most {most} bytes; give them 1 byte to 1 GiB"
            ),
            LinkError::PrefixTooSmall { most, longest } => write!(
                f,
                "a framing has records of up to {most} bytes, but its prefix tells {longest} at most; take a wider one"
            ),
            LinkError::NotPrepared => {
                f.write_str("a link runs once, after its pre_run: spawn it, or call both by hand")
            }
            LinkError::SetUp(error) => {
                write!(
                    f,
                    "the file cannot be set to fail rather than wait: {error}"
                )
            }
            LinkError::Record(bad) => bad.fmt(f),
            LinkError::Read(error) => write!(f, "reading failed: {error}"),
            LinkError::Write {
                record,
                written,
                error,
            } => write!(
                f,
                "writing failed in record {record}, after {written} of its bytes: {error}"
            ),
            LinkError::Wait(error) => error.fmt(f),
            LinkError::HungUp => {
                f.write_str("the other side has hung up, or the device was unplugged")
            }
            LinkError::Stalled { limit } => {
                write!(
                    f,
                    "nothing could be written for {limit:?}: the other side does not read"
                )
            }
            LinkError::Silent { limit } => write!(f, "no answer for {limit:?}"),
            LinkError::NotConnected { attempts, error } => {
                write!(f, "no connection after {attempts} attempts: {error}")
            }
        }
    }
}

impl std::error::Error for LinkError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            LinkError::Record(bad) => Some(bad),
            LinkError::Wait(error) => Some(error),
            _ => None,
        }
    }
}

impl From<BadRecord> for LinkError {
    fn from(bad: BadRecord) -> Self {
        LinkError::Record(bad)
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
