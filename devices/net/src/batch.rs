//! Values on their way from the link's process to its thread: encoded, in a buffer from the
//! opening.

use crate::message::{VALUE_HEAD, put_value_head};
use serde::Serialize;

/// Beyond this many bytes a batch is full.
pub(crate) const BATCH: usize = 32 * 1024;

/// Values, as they are in a message.
#[derive(Debug)]
pub(crate) struct Batch {
    buffer: Box<[u8]>,
    used: usize,
    count: u64,
    /// How many bytes a value has at most.
    capacity: usize,
}

impl Batch {
    /// For so many values at most, and so many bytes in each.
    pub(crate) fn new(values: usize, capacity: usize) -> Self {
        let one = VALUE_HEAD.saturating_add(capacity);
        let others = one.saturating_mul(values.saturating_sub(1));
        let bytes = one.saturating_add(others.min(BATCH));
        Self {
            buffer: vec![0; bytes].into_boxed_slice(),
            used: 0,
            count: 0,
            capacity,
        }
    }

    pub(crate) fn capacity(&self) -> usize {
        self.capacity
    }

    pub(crate) fn count(&self) -> u64 {
        self.count
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.buffer[..self.used]
    }

    pub(crate) fn clear(&mut self) {
        (self.used, self.count) = (0, 0);
    }

    /// Whether any value has room.
    pub(crate) fn has_room(&self) -> bool {
        self.buffer.len() - self.used >= VALUE_HEAD + self.capacity
    }

    /// Adds a value that was taken at `sent`. After an error the batch is as before.
    pub(crate) fn add<T: Serialize>(&mut self, value: &T, sent: u64) -> postcard::Result<()> {
        let free = &mut self.buffer[self.used..];
        let Some((head, rest)) = free.split_first_chunk_mut::<VALUE_HEAD>() else {
            return Err(postcard::Error::SerializeBufferFull);
        };
        let room = rest.len().min(self.capacity);
        let length = postcard::to_slice(value, &mut rest[..room])?.len();
        put_value_head(head, sent, length);
        self.used += VALUE_HEAD + length;
        self.count += 1;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::next_value;

    #[test]
    fn a_batch_has_room_for_the_values_that_it_is_made_for() {
        let mut batch = Batch::new(2, 3);
        for value in [b"abc".as_slice(), b"d"] {
            // Postcard puts the length before it, so three bytes hold two of a slice.
            let is_short = value.len() < 3;
            assert!(batch.has_room());
            assert_eq!(batch.add(&value, 7).is_ok(), is_short);
        }
        assert_eq!(batch.count(), 1);
        batch.add(&(1_u8, 2_u8), 8).unwrap();
        assert!(!batch.has_room());
        let mut rest = batch.bytes();
        assert_eq!(next_value(&mut rest), Some((7, [1, b'd'].as_slice())));
        assert_eq!(next_value(&mut rest), Some((8, [1, 2].as_slice())));
        assert!(rest.is_empty());
        batch.clear();
        assert!(batch.has_room() && batch.bytes().is_empty());
    }

    #[test]
    fn a_batch_ends_at_its_limit_of_bytes() {
        let mut batch = Batch::new(1000, 1000);
        while batch.has_room() {
            batch.add(&[0_u8; 16], 0).unwrap();
        }
        // The last of the small ones is beyond it.
        assert!((BATCH + 1..=BATCH + 28).contains(&batch.bytes().len()));
    }
}
