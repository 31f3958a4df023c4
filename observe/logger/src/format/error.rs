//! Errors of recordings.

use std::fmt;
use std::io;

/// Why a recording cannot be read, or not further, and where.
///
/// All records before the error are valid: their blocks have correct checksums.
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

/// The kind of an error.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadErrorKind {
    /// It does not begin as a recording does.
    #[error(
        "this is no recording of LUNA's logger (.luna): `System::log_to` or LUNA_LOG makes one"
    )]
    NotARecording,
    /// It is a replay log.
    #[error(
        "this is a replay log (.replay), not a recording of the logger (.luna): `luna demo --replay` or `System::replay` repeats its run"
    )]
    ReplayLog,
    /// It is of a major version that this program does not know.
    #[error("the recording has format version {}.{}, and this program reads {}.x", .found.0, .found.1, super::MAJOR)]
    Version {
        /// The recording's major and minor version.
        found: (u16, u16),
    },
    /// It ends in the middle of a block: the program was killed while writing, or is still writing.
    #[error("the recording ends in the middle of a block; all complete blocks before it are good")]
    Truncated,
    /// No block begins where one should.
    #[error("no block begins where one should")]
    NoBlock,
    /// A block states a length above [`MAX_IN_BLOCK`](super::MAX_IN_BLOCK).
    #[error("a block states a length of {length} bytes, which is more than the limit")]
    BlockTooLong {
        /// The length that it states, in bytes.
        length: u32,
    },
    /// A block's content is not what was written.
    #[error("a block is damaged: its checksum is wrong")]
    Checksum,
    /// A block is missing, or one is there twice.
    #[error("block {found} comes where block {expected} should")]
    Sequence {
        /// The number that the block should have.
        expected: u32,
        /// The number that it has.
        found: u32,
    },
    /// A record is malformed, although its block's checksum is correct.
    #[error("a record is malformed: {0}")]
    Record(&'static str),
    /// The file could not be read.
    #[error("cannot read: {0}")]
    Io(#[source] io::Error),
}

impl ReadError {
    pub(crate) fn new(offset: u64, kind: ReadErrorKind) -> Self {
        Self { offset, kind }
    }

    /// Where the error is: the offset of the wrong block or record, in bytes from the recording's
    /// beginning.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// The kind of the error.
    pub fn kind(&self) -> &ReadErrorKind {
        &self.kind
    }

    /// Whether the recording only ends too early: what is there is valid.
    pub fn is_truncated(&self) -> bool {
        matches!(self.kind, ReadErrorKind::Truncated)
    }
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (at byte {})", self.kind, self.offset)
    }
}

/// Written by hand: the kind's text is part of the message above, so the source is the kind's.
impl std::error::Error for ReadError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.kind.source()
    }
}
