//! Blocks into records, with bounded memory.

use super::checksum::crc32;
use super::decode::{Body, Types, is_known, record};
use super::error::{ReadError, ReadErrorKind};
use super::record::Record;
use super::{BLOCK_MAGIC, BLOCK_START, HEAD, MAGIC, MAJOR, MOST_IN_BLOCK};
use std::fmt;
use std::io::{ErrorKind, Read};

/// Reads a recording, record by record, from a file or a connection.
///
/// It holds one block (1 MiB at most) and two bytes for each signal declared, whatever the recording says. It never panics on what it reads. A block is looked
/// into only when it is there as a whole and its checksum is right. Not for the real-time path.
///
/// ```
/// use luna_logger::format::{Level, Reader, Record, Writer};
///
/// let mut writer = Writer::new(Vec::new())?;
/// writer.put(&Record::Message {
///     thread: 0, time: 5, level: Level::Info, process: 0, truncated: false, target: "arm", text: "homed",
/// })?;
/// let mut file = writer.finish()?;
///
/// file.truncate(file.len() - 1);
/// let mut reader = Reader::new(&file[..])?;
/// let error = reader.next().unwrap_err();
/// assert!(error.is_truncated());
/// assert_eq!(error.offset(), 16); // where the block begins that is not whole
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Reader<R> {
    input: R,
    version: (u16, u16),
    /// Where the next block begins.
    offset: u64,
    /// The records of this block.
    block: Vec<u8>,
    /// Where they begin in the recording.
    block_offset: u64,
    /// Where the next one begins among them.
    at: usize,
    sequence: u32,
    last: u64,
    types: Types,
    is_over: bool,
    has_ended: bool,
}

/// Where the next record's kind and body lie in the block.
struct Located {
    kind: u8,
    at: usize,
    begin: usize,
    end: usize,
}

impl<R: Read> Reader<R> {
    /// Reads the head.
    ///
    /// # Errors
    ///
    /// What is read is no recording, or of another major version, or cannot be read.
    pub fn new(mut input: R) -> Result<Self, ReadError> {
        let mut head = [0; HEAD];
        let got = fill(&mut input, &mut head)
            .map_err(|error| ReadError::new(0, ReadErrorKind::Io(error)))?;
        let known = got.min(MAGIC.len());
        if got == 0 || head[..known] != MAGIC[..known] {
            return Err(ReadError::new(0, ReadErrorKind::NotARecording));
        }
        if got < HEAD {
            return Err(ReadError::new(0, ReadErrorKind::Truncated));
        }
        let number = |at: usize| u16::from_le_bytes([head[at], head[at + 1]]);
        let version = (number(8), number(10));
        if version.0 != MAJOR {
            return Err(ReadError::new(8, ReadErrorKind::Version { found: version }));
        }
        Ok(Self {
            input,
            version,
            offset: HEAD as u64,
            block: Vec::new(),
            block_offset: HEAD as u64,
            at: 0,
            sequence: 0,
            last: 0,
            types: Types::default(),
            is_over: false,
            has_ended: false,
        })
    }

    /// The recording's major and minor version.
    pub fn version(&self) -> (u16, u16) {
        self.version
    }

    /// Whether the recording has said that it is whole. One that was cut off between two blocks has not.
    pub fn has_ended(&self) -> bool {
        self.has_ended
    }

    /// The next record; none at the end. Records of kinds that this version does not know are skipped.
    ///
    /// # Errors
    ///
    /// The recording is truncated or damaged: [`ReadError`] says how and where. What came before is good, and nothing follows: the next call gives none.
    #[expect(
        clippy::should_implement_trait,
        reason = "a record borrows from the reader, which an iterator's cannot"
    )]
    pub fn next(&mut self) -> Result<Option<Record<'_>>, ReadError> {
        if self.is_over {
            return Ok(None);
        }
        // What goes wrong on the way ends it.
        self.is_over = true;
        let Some(located) = self.locate()? else {
            return Ok(None);
        };
        let body = Body::new(&self.block[located.begin..located.end]);
        let record = record(located.kind, body, &mut self.last, &self.types)
            .map_err(|what| wrong(self.block_offset, located.at, what))?;
        self.has_ended |= matches!(record, Record::End { .. });
        self.is_over = false;
        Ok(Some(record))
    }

    /// Finds the next record that this version knows.
    fn locate(&mut self) -> Result<Option<Located>, ReadError> {
        loop {
            if self.at == self.block.len() {
                if !self.next_block()? {
                    return Ok(None);
                }
                continue;
            }
            let at = self.at;
            let offset = self.block_offset;
            let wrong = |what| wrong(offset, at, what);
            let mut rest = Body::new(&self.block[at..]);
            let kind = rest.byte().map_err(wrong)?;
            let length = rest.number().map_err(wrong)?;
            let begin = self.block.len() - rest.rest().len();
            let end = usize::try_from(length)
                .ok()
                .and_then(|length| begin.checked_add(length))
                .filter(|end| *end <= self.block.len())
                .ok_or_else(|| wrong("it is longer than its block"))?;
            self.at = end;
            let body = Body::new(&self.block[begin..end]);
            if is_known(kind, body, &mut self.types).map_err(wrong)? {
                return Ok(Some(Located {
                    kind,
                    at,
                    begin,
                    end,
                }));
            }
        }
    }

    /// Reads a block; false at the end.
    fn next_block(&mut self) -> Result<bool, ReadError> {
        let offset = self.offset;
        let broken = |kind| ReadError::new(offset, kind);
        let mut start = [0; BLOCK_START];
        let got =
            fill(&mut self.input, &mut start).map_err(|error| broken(ReadErrorKind::Io(error)))?;
        if got == 0 {
            return Ok(false);
        }
        let known = got.min(BLOCK_MAGIC.len());
        if start[..known] != BLOCK_MAGIC[..known] {
            return Err(broken(ReadErrorKind::NoBlock));
        }
        if got < BLOCK_START {
            return Err(broken(ReadErrorKind::Truncated));
        }
        let number = |at: usize| {
            u32::from_le_bytes([start[at], start[at + 1], start[at + 2], start[at + 3]])
        };
        let (found, length, checksum) = (number(4), number(8), number(12));
        if length as usize > MOST_IN_BLOCK {
            return Err(broken(ReadErrorKind::BlockTooLong { length }));
        }
        self.block.resize(length as usize, 0);
        self.at = self.block.len();
        let got = fill(&mut self.input, &mut self.block)
            .map_err(|error| broken(ReadErrorKind::Io(error)))?;
        if got < self.block.len() {
            return Err(broken(ReadErrorKind::Truncated));
        }
        if crc32(&[&start[4..12], &self.block]) != checksum {
            return Err(broken(ReadErrorKind::Checksum));
        }
        if found != self.sequence {
            let expected = self.sequence;
            return Err(broken(ReadErrorKind::Sequence { expected, found }));
        }
        self.sequence = self.sequence.wrapping_add(1);
        self.block_offset = offset + BLOCK_START as u64;
        self.offset = self.block_offset + u64::from(length);
        self.at = 0;
        self.last = 0;
        Ok(true)
    }
}

fn wrong(block: u64, at: usize, what: &'static str) -> ReadError {
    ReadError::new(block + at as u64, ReadErrorKind::Record(what))
}

/// Fills `to` as far as there is something; says how far.
fn fill(from: &mut impl Read, to: &mut [u8]) -> std::io::Result<usize> {
    let mut got = 0;
    while got < to.len() {
        match from.read(&mut to[got..]) {
            Ok(0) => break,
            Ok(more) => got += more,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(got)
}

impl<R> fmt::Debug for Reader<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Reader")
            .field("version", &self.version)
            .field("offset", &self.offset)
            .finish_non_exhaustive()
    }
}
