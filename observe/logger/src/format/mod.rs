//! The format of recordings, in files and over connections to a recorder.
//!
//! ```text
//!   recording = head block*          head  = magic major minor bits
//!   block     = start record*        start = "LBLK" sequence length checksum
//!   record    = kind length body
//! ```
//!
//! Numbers have a fixed size and are little-endian, or are LEB128 (7 bits a byte, lowest first), so
//! that the format does not depend on the computer. `docs/recording-format.md` has the tables.
//!
//! These changes need no new major version: new kinds of records, which an older reader skips, and
//! new fields at the end of a record's body, which it ignores.
//!
//! A [`Reader`] holds one block and the declared types of signals, whatever the file contains. A
//! file is valid up to its last complete block.

mod decode;
mod encoder;
mod error;
#[cfg(feature = "json")]
pub mod json;
pub mod protobuf;
mod reader;
mod record;
mod tally;
mod types;
mod words;
mod writer;

pub use encoder::Encoder;
pub(crate) use encoder::{checksum, seal};
pub use error::{ReadError, ReadErrorKind};
pub use reader::Reader;
pub use record::{Event, Record, RunsOn, SignalInfo, Subject};
pub use tally::Tally;
pub use types::{ClockBase, Level, Losing, Type, Value, Values};
pub use words::{Names, Words};
pub use writer::Writer;

/// Every recording begins with these bytes. The first is not ASCII, and the line ends reveal a
/// transfer in text mode.
pub const MAGIC: [u8; 8] = *b"\x89LUNA\r\n\x1a";

/// The major version of the format. This program cannot read another one.
pub const MAJOR: u16 = 1;

/// The minor version of the format. It grows with each addition.
pub const MINOR: u16 = 0;

/// What every block begins with.
pub const BLOCK_MAGIC: [u8; 4] = *b"LBLK";

/// The limit of the bytes of records in one block, which a reader has to hold.
pub const MAX_IN_BLOCK: usize = 1 << 20;

/// The most signals of a recording.
pub const MAX_SIGNALS: usize = 1 << 16;

/// The most elements of a signal.
pub const MAX_ELEMENTS: usize = 16;

/// The most bytes of any text in a record.
pub const MAX_TEXT: usize = 4096;

/// Bytes of the head: magic, major, minor, and 4 bytes that are 0.
pub(crate) const HEAD: usize = 16;

/// Bytes of a block's start: magic, sequence, length, checksum.
pub(crate) const BLOCK_START: usize = 16;

/// Kinds of records, by their numbers in the file.
pub(crate) mod kind {
    pub(crate) const SESSION: u8 = 1;
    pub(crate) const THREAD: u8 = 2;
    pub(crate) const SIGNAL: u8 = 3;
    pub(crate) const SAMPLE: u8 = 4;
    pub(crate) const MESSAGE: u8 = 5;
    pub(crate) const EVENT: u8 = 6;
    pub(crate) const NAME: u8 = 7;
    pub(crate) const LOSSES: u8 = 8;
    pub(crate) const EPOCH: u8 = 9;
    pub(crate) const END: u8 = 10;
}

/// The head of a recording of this version.
pub(crate) fn head() -> [u8; HEAD] {
    let mut head = [0; HEAD];
    head[..8].copy_from_slice(&MAGIC);
    head[8..10].copy_from_slice(&MAJOR.to_le_bytes());
    head[10..12].copy_from_slice(&MINOR.to_le_bytes());
    head
}
