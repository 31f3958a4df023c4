//! The file: a head, then blocks, each with its length and a checksum over its place in the file,
//! its kind and its bytes.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use super::error::RecordError;
use std::fs::File;
use std::io::{BufWriter, Write};

pub(super) const VERSION: u16 = 2;
const MAGIC: &[u8; 8] = b"LUNAREPL";
/// What a recording of the logger begins with.
const MAGIC_OF_LOGGER: &[u8; 8] = b"\x89LUNA\r\n\x1a";
/// Magic, version, their checksum.
const HEAD: usize = 14;
/// Length and checksum of a block.
const BLOCK_HEAD: usize = 8;
/// The longest block that is believed.
const LONGEST: usize = 1 << 24;

/// What a block is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum BlockKind {
    /// The system's name.
    System = 1,
    /// A process: its number, that of its parent, which it is of its name there, and the name.
    Process = 2,
    /// Bytes of a process' events: its number, and the bytes.
    Events = 3,
    /// How many events of a process were lost: its number, and theirs.
    Lost = 4,
    /// The recording is whole.
    End = 5,
    /// What a process did that is not recorded: its number, and a text.
    Outside = 6,
    /// The note that the program reads back.
    Note = 7,
    /// What a parameter began with: how long its name is, that, and the value as a text.
    Parameter = 8,
}

impl BlockKind {
    fn of(byte: u8) -> Option<Self> {
        use BlockKind::{End, Events, Lost, Note, Outside, Parameter, Process, System};
        [System, Process, Events, Lost, End, Outside, Note, Parameter]
            .into_iter()
            .find(|&kind| kind as u8 == byte)
    }
}

fn checksum(number: u64, kind_and_bytes: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&number.to_le_bytes());
    hasher.update(kind_and_bytes);
    hasher.finalize()
}

/// Writes blocks.
pub(super) struct Writer {
    to: BufWriter<File>,
    blocks: u64,
    block: Vec<u8>,
    /// The size of the file.
    pub(super) bytes: u64,
}

impl Writer {
    /// Begins a file that is empty.
    pub(super) fn begin(file: File) -> std::io::Result<Self> {
        let mut to = BufWriter::new(file);
        let mut head = MAGIC.to_vec();
        head.extend(VERSION.to_le_bytes());
        let sum = checksum(0, &head);
        head.extend(sum.to_le_bytes());
        to.write_all(&head)?;
        Ok(Self {
            to,
            blocks: 0,
            block: Vec::new(),
            bytes: HEAD as u64,
        })
    }

    pub(super) fn block(&mut self, kind: BlockKind, parts: &[&[u8]]) -> std::io::Result<()> {
        self.block.clear();
        self.block.push(kind as u8);
        parts.iter().for_each(|part| self.block.extend(*part));
        self.blocks = self.blocks.saturating_add(1);
        let length = BLOCK_HEAD.saturating_add(self.block.len());
        self.bytes = self.bytes.saturating_add(length as u64);
        self.to
            .write_all(&(self.block.len() as u32).to_le_bytes())?;
        self.to
            .write_all(&checksum(self.blocks, &self.block).to_le_bytes())?;
        self.to.write_all(&self.block)
    }

    /// A block about the process with this index.
    pub(super) fn block_of(
        &mut self,
        process: usize,
        kind: BlockKind,
        bytes: &[u8],
    ) -> std::io::Result<()> {
        self.block(kind, &[&(process as u32).to_le_bytes(), bytes])
    }

    pub(super) fn flush(&mut self) -> std::io::Result<()> {
        self.to.flush()
    }
}

fn word(bytes: &[u8]) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(..4)?.try_into().ok()?))
}

/// A block: its kind and bytes.
pub(super) type Block<'a> = (BlockKind, &'a [u8]);

/// The blocks of a file, as far as they are whole, and what is wrong after them.
pub(super) fn blocks(file: &[u8]) -> Result<(Vec<Block<'_>>, Option<RecordError>), RecordError> {
    if file.starts_with(MAGIC_OF_LOGGER) {
        return Err(RecordError::OfTheLogger);
    }
    if !file.starts_with(MAGIC) {
        return Err(RecordError::NoRecording);
    }
    let (Some(head), Some(sum)) = (file.get(..HEAD - 4), file.get(HEAD - 4..).and_then(word))
    else {
        return Err(RecordError::Truncated { offset: 0 });
    };
    if sum != checksum(0, head) {
        return Err(RecordError::Damaged { offset: 0 });
    }
    let version = u16::from_le_bytes([head[8], head[9]]);
    if version != VERSION {
        return Err(RecordError::Version(version));
    }
    let mut blocks = Vec::new();
    let mut at = HEAD;
    loop {
        let offset = at as u64;
        let damaged = || Some(RecordError::Damaged { offset });
        let truncated = || Some(RecordError::Truncated { offset });
        if let Some((BlockKind::End, _)) = blocks.last() {
            let is_over = at == file.len();
            return Ok((blocks, if is_over { None } else { damaged() }));
        }
        let rest = &file[at..];
        let (Some(length), Some(sum)) = (word(rest), rest.get(4..).and_then(word)) else {
            return Ok((blocks, truncated()));
        };
        let length = length as usize;
        if length == 0 || length > LONGEST {
            return Ok((blocks, damaged()));
        }
        let whole = BLOCK_HEAD.saturating_add(length);
        let Some(block) = rest.get(BLOCK_HEAD..whole) else {
            return Ok((blocks, truncated()));
        };
        let kind = BlockKind::of(block[0]);
        match kind {
            Some(kind) if sum == checksum((blocks.len() as u64).saturating_add(1), block) => {
                blocks.push((kind, &block[1..]));
            }
            _ => return Ok((blocks, damaged())),
        }
        at = at.saturating_add(whole);
    }
}
