//! Records into blocks.

use super::record::{Event, Record, RunsOn, SignalInfo};
use super::types::{Losing, Values};
use super::{BLOCK_MAGIC, BLOCK_START, MAX_TEXT, head, kind};

/// A block is full at this size. It is less than a tenth of the limit, so that the last record
/// always fits.
const FULL: usize = 64 << 10;

/// Makes blocks of records, without writing them anywhere.
///
/// Not for the real-time path. It holds one block in memory: take the block when it [is
/// full](Self::is_full).
///
/// ```
/// use luna_logger::format::{Encoder, Reader, Record};
///
/// let mut encoder = Encoder::new();
/// let mut file = Encoder::head().to_vec();
/// encoder.put(&Record::End { time: 7 });
/// file.extend_from_slice(encoder.block());
/// encoder.next();
///
/// let mut reader = Reader::new(&file[..])?;
/// assert_eq!(reader.next()?, Some(Record::End { time: 7 }));
/// # Ok::<(), luna_logger::format::ReadError>(())
/// ```
#[derive(Debug)]
pub struct Encoder {
    /// Room for the block's start, and the records.
    block: Vec<u8>,
    body: Vec<u8>,
    sequence: u32,
    full: usize,
    /// The time of the last record of the block that has one.
    last: u64,
}

impl Encoder {
    /// Creates an encoder. Its first block has number 0.
    pub fn new() -> Self {
        Self::with_block_size(FULL)
    }

    /// Creates an encoder with blocks that are full at `size` bytes, at most 64 KiB, for transports
    /// with small units such as datagrams. A block exceeds that by its last record at most.
    ///
    /// ```
    /// use luna_logger::format::{Encoder, Record};
    /// let mut encoder = Encoder::with_block_size(100);
    /// while !encoder.is_full() {
    ///     encoder.put(&Record::End { time: 7 });
    /// }
    /// assert!(encoder.block().len() < 110);
    /// ```
    pub fn with_block_size(size: usize) -> Self {
        let full = size.min(FULL);
        let mut block = Vec::with_capacity(full + full / 2);
        block.resize(BLOCK_START, 0);
        Self {
            block,
            body: Vec::with_capacity(256),
            sequence: 0,
            full,
            last: 0,
        }
    }

    /// The bytes before the first block.
    pub fn head() -> [u8; 16] {
        head()
    }

    /// Whether a block begins with the session, after which everything is declared.
    pub(crate) fn is_session(block: &[u8]) -> bool {
        block.get(BLOCK_START) == Some(&kind::SESSION)
    }

    /// Whether the block holds nothing.
    pub fn is_empty(&self) -> bool {
        self.block.len() == BLOCK_START
    }

    /// Bytes of the block so far, with its start.
    pub fn len(&self) -> usize {
        self.block.len()
    }

    /// Whether the block has to be taken before more records are added.
    pub fn is_full(&self) -> bool {
        self.block.len() >= self.full
    }

    /// Adds a record. Texts are cut after 4096 bytes.
    pub fn put(&mut self, record: &Record<'_>) {
        self.body.clear();
        let kind = self.fill(record);
        self.block.push(kind);
        number(&mut self.block, self.body.len() as u64);
        self.block.extend_from_slice(&self.body);
    }

    /// The finished block, with its header. Empty if it has no records.
    pub fn block(&mut self) -> &[u8] {
        if self.is_empty() {
            return &[];
        }
        seal(&mut self.block, self.sequence);
        &self.block
    }

    /// Begins the next block, after this one was written.
    pub fn next(&mut self) {
        self.sequence = self.sequence.wrapping_add(1);
        self.discard();
    }

    /// Discards the block, which could not be written. The next block gets its number.
    pub fn discard(&mut self) {
        self.block.truncate(BLOCK_START);
        self.last = 0;
    }

    fn fill(&mut self, record: &Record<'_>) -> u8 {
        match *record {
            Record::Session {
                system,
                clock,
                written_by,
            } => {
                self.body.push(clock as u8);
                self.text(system);
                self.text(written_by);
                kind::SESSION
            }
            Record::Thread { number: of, name } => {
                self.number(of.into());
                self.text(name);
                kind::THREAD
            }
            Record::Signal(SignalInfo {
                number: of,
                element_type,
                elements,
                name,
                unit,
                description,
            }) => {
                self.number(of.into());
                self.body.extend([element_type as u8, elements]);
                self.text(name);
                self.text(unit);
                self.text(description);
                kind::SIGNAL
            }
            Record::Sample {
                signal,
                time,
                values,
            } => {
                self.sample(signal, time, values);
                kind::SAMPLE
            }
            Record::Message {
                thread,
                time,
                level,
                process,
                truncated,
                target,
                text,
            } => {
                self.number(thread.into());
                self.time(time);
                self.body.extend([level as u8, u8::from(truncated)]);
                self.number(process.into());
                self.text(target);
                self.text(text);
                kind::MESSAGE
            }
            Record::Event(Event {
                thread,
                time,
                code,
                subject,
                arguments,
            }) => {
                self.number(thread.into());
                self.time(time);
                self.number(code.into());
                self.number(subject.into());
                self.number(arguments[0]);
                self.number(arguments[1]);
                kind::EVENT
            }
            Record::Name {
                subject,
                number: of,
                parent,
                name,
                runs_on,
            } => {
                self.body.push(subject as u8);
                self.number(of.into());
                self.number(parent.into());
                self.text(name);
                if let Some(RunsOn { executor, level }) = runs_on {
                    self.number(executor.into());
                    self.number(level.into());
                }
                kind::NAME
            }
            Record::Losses { of, lost } => {
                let (what, of) = match of {
                    Losing::Signal(number) => (1, number),
                    Losing::Messages(thread) => (2, thread),
                    Losing::Events(thread) => (3, thread),
                    Losing::Blocks => (4, 0),
                };
                self.body.push(what);
                self.number(of.into());
                self.number(lost);
                kind::LOSSES
            }
            Record::Epoch { time, unix } => {
                self.time(time);
                self.body.extend(unix.to_le_bytes());
                kind::EPOCH
            }
            Record::End { time } => {
                self.time(time);
                kind::END
            }
        }
    }

    #[inline]
    fn sample(&mut self, signal: u32, time: u64, values: Values<'_>) {
        self.number(signal.into());
        self.time(time);
        self.body.extend_from_slice(values.bytes());
    }

    fn number(&mut self, value: u64) {
        number(&mut self.body, value);
    }

    /// The difference to the time before. It may be negative: the sign is the lowest bit, so that
    /// small differences of either sign are short.
    fn time(&mut self, time: u64) {
        let distance = time.wrapping_sub(self.last) as i64;
        self.last = time;
        number(&mut self.body, (distance << 1 ^ distance >> 63) as u64);
    }

    fn text(&mut self, text: &str) {
        let text = &text[..text.floor_char_boundary(MAX_TEXT)];
        self.number(text.len() as u64);
        self.body.extend_from_slice(text.as_bytes());
    }
}

/// Fills in a block's start.
pub(crate) fn seal(block: &mut [u8], sequence: u32) {
    let length = (block.len() - BLOCK_START) as u32;
    block[..4].copy_from_slice(&BLOCK_MAGIC);
    block[4..8].copy_from_slice(&sequence.to_le_bytes());
    block[8..12].copy_from_slice(&length.to_le_bytes());
    let checksum = checksum(block);
    block[12..BLOCK_START].copy_from_slice(&checksum.to_le_bytes());
}

/// The CRC-32 of a block's sequence, length and records.
pub(crate) fn checksum(block: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&block[4..12]);
    hasher.update(&block[BLOCK_START..]);
    hasher.finalize()
}

impl Default for Encoder {
    fn default() -> Self {
        Self::new()
    }
}

/// LEB128: seven bits a byte, lowest first; the highest bit says that another byte follows.
fn number(to: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        to.push(value as u8 | 0x80);
        value >>= 7;
    }
    to.push(value as u8);
}
