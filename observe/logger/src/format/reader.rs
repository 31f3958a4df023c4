//! Blocks into records, with bounded memory.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use super::decode::{Body, Types, is_known, record};
use super::error::{ReadError, ReadErrorKind};
use super::record::Record;
use super::{BLOCK_MAGIC, BLOCK_START, HEAD, MAGIC, MAJOR, MAX_IN_BLOCK};
use std::io::{ErrorKind, Read};

/// What a replay log begins with, which another part of LUNA reads.
const REPLAY_MAGIC: &[u8] = b"LUNAREPL";

/// Reads a recording, record by record, from a file or a connection.
///
/// It holds one block twice (at most 1 MiB each) and two bytes for each declared signal, whatever
/// the recording contains. It never panics on its input. A block is decoded only when it is
/// complete and its checksum is correct. Not for the real-time path.
///
/// ```
/// use luna_logger::format::{Level, Reader, Record, Writer};
///
/// let mut writer = Writer::new(Vec::new())?;
/// writer.put(&Record::Message {
///     thread: 0,
///     time: 5,
///     level: Level::Info,
///     process: 0,
///     truncated: false,
///     target: "arm",
///     text: "homed",
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
    /// Bytes read from there on but not consumed: at most a block and its header.
    ahead: Vec<u8>,
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
    missing: u64,
}

/// The position of the next record's kind and body in the block.
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
    /// The input is not a recording, has another major version, or cannot be read.
    pub fn new(mut input: R) -> Result<Self, ReadError> {
        let mut head = [0; HEAD];
        let got = fill(&mut input, &mut head)
            .map_err(|error| ReadError::new(0, ReadErrorKind::Io(error)))?;
        if head.starts_with(REPLAY_MAGIC) {
            return Err(ReadError::new(0, ReadErrorKind::ReplayLog));
        }
        let known = got.min(MAGIC.len());
        if got == 0 || head[..known] != MAGIC[..known] {
            return Err(ReadError::new(0, ReadErrorKind::NotARecording));
        }
        if got < HEAD {
            return Err(ReadError::new(0, ReadErrorKind::Truncated));
        }
        let number = |at: usize| {
            head[at..]
                .first_chunk()
                .map_or(0, |bytes| u16::from_le_bytes(*bytes))
        };
        let version = (number(8), number(10));
        if version.0 != MAJOR {
            return Err(ReadError::new(8, ReadErrorKind::Version { found: version }));
        }
        Ok(Self {
            input,
            version,
            offset: HEAD as u64,
            ahead: Vec::new(),
            block: Vec::new(),
            block_offset: HEAD as u64,
            at: 0,
            sequence: 0,
            last: 0,
            types: Types::default(),
            is_over: false,
            has_ended: false,
            missing: 0,
        })
    }

    /// The recording's major and minor version.
    pub fn version(&self) -> (u16, u16) {
        self.version
    }

    /// The input. Bytes added to it after [`next`](Self::next) returned none are read as if they
    /// had been there before, so that a growing recording can be followed.
    ///
    /// ```
    /// use luna_logger::format::{Encoder, Reader, Record};
    /// use std::collections::VecDeque;
    ///
    /// let mut reader = Reader::new(VecDeque::from(Encoder::head()))?;
    /// assert_eq!(reader.next()?, None);
    /// let mut encoder = Encoder::new();
    /// encoder.put(&Record::End { time: 7 });
    /// reader.input().extend(encoder.block());
    /// assert_eq!(reader.next()?, Some(Record::End { time: 7 }));
    /// # Ok::<(), luna_logger::format::ReadError>(())
    /// ```
    pub fn input(&mut self) -> &mut R {
        &mut self.input
    }

    /// How many blocks are missing between those that were read, by their numbers. 0 until
    /// [`resume`](Self::resume) has skipped a gap.
    pub fn missing_blocks(&self) -> u64 {
        self.missing
    }

    /// Whether the recording's end record was read. A recording that was cut off between two blocks
    /// has none.
    pub fn has_ended(&self) -> bool {
        self.has_ended
    }

    /// The next record; none at the end. Records of unknown kinds are skipped.
    ///
    /// # Errors
    ///
    /// The recording is truncated or damaged: [`ReadError`] says how and where. Records returned
    /// before are valid. The next call returns none, unless [`resume`](Self::resume) finds another
    /// block.
    #[expect(
        clippy::should_implement_trait,
        reason = "a record borrows from the reader, which an iterator's cannot"
    )]
    pub fn next(&mut self) -> Result<Option<Record<'_>>, ReadError> {
        if self.is_over {
            return Ok(None);
        }
        // An error ends the reading.
        self.is_over = true;
        let Some(located) = self.locate()? else {
            self.is_over = false;
            return Ok(None);
        };
        let body = Body::new(&self.block[located.begin..located.end]);
        let record = record(located.kind, body, &mut self.last, &self.types)
            .map_err(|what| wrong(self.block_offset, located.at, what))?;
        self.has_ended |= matches!(record, Record::End { .. });
        self.is_over = false;
        Ok(Some(record))
    }

    /// After an error: looks for the next complete block, at which [`next`](Self::next) continues.
    /// Returns the number of bytes skipped, or none if no block follows; then reading has ended.
    /// Records in the damaged part are missing, and samples of signals that were declared there are
    /// errors.
    ///
    /// Cost: O(bytes) for ordinary damage. Each byte that looks like a block's beginning costs as
    /// much as the block it announces, so hostile input may cost 1 MiB of reading for each four
    /// bytes.
    ///
    /// # Errors
    ///
    /// The input cannot be read.
    ///
    /// ```
    /// use luna_logger::format::{Reader, Record, Writer};
    ///
    /// let mut writer = Writer::new(Vec::new())?;
    /// for time in [1, 2, 3] {
    ///     writer.put(&Record::End { time })?;
    ///     writer.end_block()?;
    /// }
    /// let mut file = writer.finish()?;
    /// file[16 + 19 + 17] ^= 1; // in the second block
    /// let mut reader = Reader::new(&file[..])?;
    /// assert_eq!(reader.next()?, Some(Record::End { time: 1 }));
    /// assert!(reader.next().is_err());
    /// assert_eq!(reader.resume()?, Some(19));
    /// assert_eq!(reader.next()?, Some(Record::End { time: 3 }));
    /// assert_eq!(reader.missing_blocks(), 1);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn resume(&mut self) -> Result<Option<u64>, ReadError> {
        if !self.is_over {
            return Ok(Some(0));
        }
        self.at = self.block.len();
        let begin = self.offset;
        loop {
            match self.next_block(true) {
                Ok(true) => {
                    self.is_over = false;
                    let begun = self.block_offset.saturating_sub(BLOCK_START as u64);
                    let skipped = begun.saturating_sub(begin);
                    return Ok(Some(skipped));
                }
                Ok(false) => {
                    // The input may grow.
                    self.is_over = false;
                    return Ok(None);
                }
                Err(error) if matches!(error.kind(), ReadErrorKind::Io(_)) => return Err(error),
                Err(_) => self.skip(),
            }
        }
    }

    /// After an error in a record: skips the rest of its block.
    pub(crate) fn skip_block(&mut self) {
        self.at = self.block.len();
        self.is_over = false;
    }

    /// Skips at least one byte, up to the next possible beginning of a block.
    fn skip(&mut self) {
        let next = self.ahead.get(1..).unwrap_or_default();
        // The last three bytes may be its beginning.
        let at = next
            .windows(BLOCK_MAGIC.len())
            .position(|bytes| bytes == BLOCK_MAGIC)
            .unwrap_or(next.len().saturating_sub(3))
            .saturating_add(1);
        self.ahead.drain(..at);
        self.offset = self.offset.saturating_add(at as u64);
    }

    /// Finds the next record that this version knows.
    fn locate(&mut self) -> Result<Option<Located>, ReadError> {
        loop {
            if self.at == self.block.len() {
                if !self.next_block(false)? {
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
            let begin = self.block.len().saturating_sub(rest.rest().len());
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

    /// Reads a block; false at the end. On an error nothing is consumed.
    fn next_block(&mut self, after_damage: bool) -> Result<bool, ReadError> {
        let offset = self.offset;
        let broken = |kind| ReadError::new(offset, kind);
        let io = |error| broken(ReadErrorKind::Io(error));
        let got = self.look(BLOCK_START).map_err(io)?;
        if got == 0 {
            return Ok(false);
        }
        let start = &self.ahead[..got];
        let known = got.min(BLOCK_MAGIC.len());
        if start[..known] != BLOCK_MAGIC[..known] {
            return Err(broken(ReadErrorKind::NoBlock));
        }
        if got < BLOCK_START {
            return Err(broken(ReadErrorKind::Truncated));
        }
        let number = |at: usize| {
            start[at..]
                .first_chunk()
                .map_or(0, |bytes| u32::from_le_bytes(*bytes))
        };
        let (found, length, checksum) = (number(4), number(8), number(12));
        if length as usize > MAX_IN_BLOCK {
            return Err(broken(ReadErrorKind::BlockTooLong { length }));
        }
        let whole = BLOCK_START.saturating_add(length as usize);
        if self.look(whole).map_err(io)? < whole {
            return Err(broken(ReadErrorKind::Truncated));
        }
        if super::checksum(&self.ahead[..whole]) != checksum {
            return Err(broken(ReadErrorKind::Checksum));
        }
        if found != self.sequence && !after_damage {
            let expected = self.sequence;
            return Err(broken(ReadErrorKind::Sequence { expected, found }));
        }
        // A repeated block is behind, and none is missing.
        let gap = found.wrapping_sub(self.sequence);
        let gap = u64::from(gap.cast_signed().max(0).cast_unsigned());
        self.missing = self.missing.saturating_add(gap);
        self.sequence = found.wrapping_add(1);
        self.block.clear();
        self.block
            .extend_from_slice(&self.ahead[BLOCK_START..whole]);
        self.ahead.drain(..whole);
        self.block_offset = offset.saturating_add(BLOCK_START as u64);
        self.offset = offset.saturating_add(whole as u64);
        self.at = 0;
        self.last = 0;
        Ok(true)
    }

    /// Reads until `length` bytes are ahead or the input ends. Returns how many are ahead, at most
    /// `length`.
    fn look(&mut self, length: usize) -> std::io::Result<usize> {
        let before = self.ahead.len();
        if before < length {
            self.ahead.resize(length, 0);
            let got = fill(&mut self.input, &mut self.ahead[before..]);
            self.ahead
                .truncate(before.saturating_add(got.as_ref().copied().unwrap_or(0)));
            got?;
        }
        Ok(self.ahead.len().min(length))
    }
}

fn wrong(block: u64, at: usize, what: &'static str) -> ReadError {
    ReadError::new(block.saturating_add(at as u64), ReadErrorKind::Record(what))
}

/// Reads until `to` is full or the input ends. Returns how many bytes were read.
fn fill(from: &mut impl Read, to: &mut [u8]) -> std::io::Result<usize> {
    let mut got = 0;
    while got < to.len() {
        match from.read(&mut to[got..]) {
            Ok(0) => break,
            Ok(more) => got = got.saturating_add(more),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(got)
}

luna_platform::debug_fields!(
    impl[R] Reader<R>, |reader|
    version: reader.version,
    offset: reader.offset
);
