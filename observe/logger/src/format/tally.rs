//! How much is in a block, without looking into its records.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use super::decode::Body;
use super::{BLOCK_START, MAX_SIGNALS, kind};
use std::collections::BTreeMap;

/// The number of samples, messages and events in blocks, which is what is lost with them.
///
/// ```
/// use luna_logger::format::{Encoder, Level, Record, Tally};
///
/// let mut encoder = Encoder::new();
/// encoder.put(&Record::Message {
///     thread: 0,
///     time: 5,
///     level: Level::Info,
///     process: 0,
///     truncated: false,
///     target: "arm",
///     text: "homed",
/// });
/// let mut tally = Tally::default();
/// tally.add(encoder.block());
/// assert_eq!((tally.blocks, tally.messages), (1, 1));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct Tally {
    /// How many blocks.
    pub blocks: u64,
    /// How many bytes.
    pub bytes: u64,
    /// How many samples, by the signal's number.
    pub samples: BTreeMap<u32, u64>,
    /// How many messages.
    pub messages: u64,
    /// How many events, by the thread's number.
    pub events: BTreeMap<u32, u64>,
    /// Whether the end of the recording is in one.
    pub has_end: bool,
}

impl Tally {
    /// Adds the contents of a block. Of a malformed block it counts what can be read. O(records).
    /// Invalid signal numbers are ignored, so that its memory is bounded.
    pub fn add(&mut self, block: &[u8]) {
        self.blocks = self.blocks.saturating_add(1);
        self.bytes = self.bytes.saturating_add(block.len() as u64);
        let mut rest = block.get(BLOCK_START..).unwrap_or_default();
        while let Some(after) = self.add_record(rest) {
            rest = after;
        }
    }

    /// Whether nothing was added.
    pub fn is_empty(&self) -> bool {
        self.blocks == 0
    }

    fn add_record<'a>(&mut self, bytes: &'a [u8]) -> Option<&'a [u8]> {
        let mut body = Body::new(bytes);
        let kind = body.byte().ok()?;
        let length = usize::try_from(body.number().ok()?).ok()?;
        let (record, rest) = body.rest().split_at_checked(length)?;
        let number = || u32::try_from(Body::new(record).number().ok()?).ok();
        match kind {
            kind::SAMPLE => count(&mut self.samples, number()?),
            kind::MESSAGE => self.messages = self.messages.saturating_add(1),
            kind::EVENT => count(&mut self.events, number()?),
            kind::END => self.has_end = true,
            _ => {}
        }
        Some(rest)
    }
}

/// One more of `number`, among as many as a recording has.
fn count(of: &mut BTreeMap<u32, u64>, number: u32) {
    if (number as usize) < MAX_SIGNALS {
        let count = of.entry(number).or_default();
        *count = count.saturating_add(1);
    }
}
