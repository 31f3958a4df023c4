//! What a sender keeps of its values: those that were sent and not acknowledged, and those that
//! are still to be sent.

use crate::batch::{BATCH, Batch};
use crate::message::next_value;
use std::collections::VecDeque;

pub(crate) struct Outbox {
    /// The values, one behind the other, as they are in a message.
    bytes: VecDeque<u8>,
    /// How many bytes each of them has.
    lengths: VecDeque<usize>,
    /// How many of them were sent, and their bytes.
    sent: (usize, usize),
    /// The number of the last one.
    last: u64,
    /// Tells the link's process of values that were acknowledged.
    notify: Box<dyn FnMut() + Send>,
}

impl Outbox {
    pub(crate) fn new(notify: impl FnMut() + Send + 'static) -> Self {
        Self {
            bytes: VecDeque::new(),
            lengths: VecDeque::new(),
            sent: (0, 0),
            last: 0,
            notify: Box::new(notify),
        }
    }

    /// A partner has said hello. Values go on after `last`.
    pub(crate) fn start(&mut self, last: u64) {
        self.last = last;
    }

    pub(crate) fn last(&self) -> u64 {
        self.last
    }

    /// The number of the first one that is kept, or of the next.
    fn first(&self) -> u64 {
        self.acknowledged() + 1
    }

    pub(crate) fn add(&mut self, batch: &Batch) {
        let mut rest = batch.bytes();
        let mut before = rest.len();
        self.bytes.extend(rest);
        while next_value(&mut rest).is_some() {
            self.lengths.push_back(before - rest.len());
            before = rest.len();
            self.last += 1;
        }
    }

    /// Values up to this number were acknowledged; how many of them are new.
    pub(crate) fn acknowledge(&mut self, taken: u64) -> u64 {
        let count = taken.saturating_add(1).saturating_sub(self.first());
        let count = count.min(self.lengths.len() as u64) as usize;
        let bytes = self.lengths.drain(..count).sum();
        self.bytes.drain(..bytes);
        self.sent.0 = self.sent.0.saturating_sub(count);
        self.sent.1 = self.sent.1.saturating_sub(bytes);
        count as u64
    }

    /// The number of the last one that was acknowledged.
    pub(crate) fn acknowledged(&self) -> u64 {
        self.last - self.lengths.len() as u64
    }

    /// Wakes the link's process: what was acknowledged is in its status.
    pub(crate) fn notify(&mut self) {
        (self.notify)();
    }

    /// How many values were sent that the partner has not, if the last that has arrived there has
    /// this number.
    pub(crate) fn missing(&self, arrived: u64) -> usize {
        self.sent.0 - self.there(arrived).min(self.sent.0)
    }

    fn there(&self, arrived: u64) -> usize {
        arrived.saturating_add(1).saturating_sub(self.first()) as usize
    }

    /// What has not arrived is to be sent again.
    pub(crate) fn send_again(&mut self, arrived: u64) {
        let there = self.there(arrived).min(self.sent.0);
        self.sent = (there, self.lengths.range(..there).sum());
    }

    /// Whether a value waits that is to be sent.
    pub(crate) fn waits(&self) -> bool {
        self.sent.0 < self.lengths.len()
    }

    /// The number of the next value to be sent.
    pub(crate) fn next(&self) -> Option<u64> {
        self.waits().then(|| self.first() + self.sent.0 as u64)
    }

    /// Adds values to a message, up to the limit of its bytes.
    pub(crate) fn fill(&mut self, message: &mut Vec<u8>) {
        let (mut count, mut end) = self.sent;
        for length in self.lengths.range(count..) {
            (count, end) = (count + 1, end + length);
            if end - self.sent.1 > BATCH {
                break;
            }
        }
        let (begin, (front, back)) = (self.sent.1, self.bytes.as_slices());
        let cut = front.len();
        // Also for the checksum.
        message.reserve(end - begin + 4);
        message.extend_from_slice(&front[begin.min(cut)..end.min(cut)]);
        message.extend_from_slice(&back[begin.max(cut) - cut..end.max(cut) - cut]);
        self.sent = (count, end);
    }
}
