//! What is wrong with a recording.

use std::fmt;
use std::io;

/// Why a recording cannot be read, or not further, and where.
///
/// All records that came before it are good: they lie in blocks whose checksum is right.
///
/// ```
/// use luna_logger::format::{ReadErrorKind, Reader};
///
/// let error = Reader::new(&b"GIF89a, no recording at all"[..]).unwrap_err();
/// assert!(matches!(error.kind(), ReadErrorKind::NotARecording));
/// assert_eq!(error.offset(), 0);
/// ```
#[derive(Debug)]
pub struct ReadError {
    offset: u64,
    kind: ReadErrorKind,
}

/// What is wrong with a recording.
#[derive(Debug)]
#[non_exhaustive]
pub enum ReadErrorKind {
    /// It does not begin as a recording does.
    NotARecording,
    /// It is of a major version that this program does not know.
    Version {
        /// The recording's major and minor version.
        found: (u16, u16),
    },
    /// It ends in the middle of a block: the program that wrote it was killed, or still writes.
    Truncated,
    /// Where a block is to begin there is none.
    NoBlock,
    /// A block says that it is longer than any block may be.
    BlockTooLong {
        /// The length that it states, in bytes.
        length: u32,
    },
    /// A block's content is not what was written.
    Checksum,
    /// A block is missing, or one is there twice.
    Sequence {
        /// The number that the block should have.
        expected: u32,
        /// The number that it has.
        found: u32,
    },
    /// A record makes no sense, though its block's checksum is right.
    Record(&'static str),
    /// The file could not be read.
    Io(io::Error),
}

impl ReadError {
    pub(crate) fn new(offset: u64, kind: ReadErrorKind) -> Self {
        Self { offset, kind }
    }

    /// Where in the recording, in bytes from its beginning: the block or record that is wrong.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// What is wrong.
    pub fn kind(&self) -> &ReadErrorKind {
        &self.kind
    }

    /// Whether the recording only ends too early: what is there is whole.
    pub fn is_truncated(&self) -> bool {
        matches!(self.kind, ReadErrorKind::Truncated)
    }
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.kind {
            ReadErrorKind::NotARecording => f.write_str("this is no recording of LUNA")?,
            ReadErrorKind::Version {
                found: (major, minor),
            } => write!(
                f,
                "the recording has format version {major}.{minor}, and this program reads {}.x",
                super::MAJOR
            )?,
            ReadErrorKind::Truncated => f.write_str(
                "the recording ends in the middle of a block; all complete blocks before it are good",
            )?,
            ReadErrorKind::NoBlock => f.write_str("no block begins where one should")?,
            ReadErrorKind::BlockTooLong { length } => {
                write!(f, "a block says that it has {length} bytes, more than any may have")?;
            }
            ReadErrorKind::Checksum => f.write_str("a block is damaged: its checksum is wrong")?,
            ReadErrorKind::Sequence { expected, found } => {
                write!(f, "block {found} comes where block {expected} should")?;
            }
            ReadErrorKind::Record(what) => write!(f, "a record makes no sense: {what}")?,
            ReadErrorKind::Io(error) => write!(f, "cannot read: {error}")?,
        }
        write!(f, " (at byte {})", self.offset)
    }
}

impl std::error::Error for ReadError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match &self.kind {
            ReadErrorKind::Io(error) => Some(error),
            _ => None,
        }
    }
}
