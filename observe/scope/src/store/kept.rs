//! Blocks of records, in bounded memory.

use super::time;
use luna_logger::format::{Encoder, Record};
use std::collections::VecDeque;
use std::sync::Arc;

/// The last blocks of some kinds of records, and the one that is being filled.
#[derive(Debug)]
pub(super) struct Kept {
    encoder: Encoder,
    blocks: VecDeque<Block>,
    /// The number of the first of them since the recording began.
    pub(super) first: u64,
    pub(super) bytes: usize,
    /// The bytes of all records since the recording began.
    pub(super) written: u64,
    most_bytes: usize,
    /// The first time of the block that is being filled.
    start: Option<u64>,
}

#[derive(Debug)]
struct Block {
    bytes: Arc<[u8]>,
    /// The first time in it.
    start: Option<u64>,
}

impl Kept {
    pub(super) fn new(most_bytes: usize) -> Self {
        Self {
            encoder: Encoder::new(),
            blocks: VecDeque::new(),
            first: 0,
            bytes: 0,
            written: 0,
            most_bytes,
            start: None,
        }
    }

    pub(super) fn put(&mut self, record: &Record<'_>) {
        self.start = self.start.or(time(record));
        let before = self.encoder.len();
        self.encoder.put(record);
        self.written += (self.encoder.len() - before) as u64;
        if self.encoder.is_full() {
            self.cut();
        }
    }

    /// The number of the block that is being filled.
    pub(super) fn current(&self) -> u64 {
        self.first + self.blocks.len() as u64
    }

    /// Ends the block that is being filled.
    pub(super) fn cut(&mut self) {
        if self.encoder.is_empty() {
            return;
        }
        let block = Block {
            bytes: self.encoder.block().into(),
            start: self.start.take(),
        };
        self.encoder.next();
        self.bytes += block.bytes.len();
        self.blocks.push_back(block);
        while self.bytes > self.most_bytes && self.blocks.len() > 1 {
            if let Some(block) = self.blocks.pop_front() {
                self.bytes -= block.bytes.len();
                self.first += 1;
            }
        }
    }

    /// The first time of what is kept, if that is not all.
    pub(super) fn kept_from(&self) -> Option<u64> {
        let mut blocks = self.blocks.iter().filter(|_| self.first > 0);
        blocks.find_map(|block| block.start)
    }

    /// The blocks from number `next` on.
    pub(super) fn since(&self, next: u64) -> impl Iterator<Item = &Arc<[u8]>> {
        let before = next.saturating_sub(self.first) as usize;
        self.blocks.iter().skip(before).map(|block| &block.bytes)
    }

    #[cfg(test)]
    pub(super) fn held(&self) -> usize {
        self.blocks.iter().map(|block| block.bytes.len()).sum()
    }
}
