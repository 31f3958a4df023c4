//! The reading end of a ring.

use crate::lane::Head;
#[cfg(feature = "events")]
use luna_events as events;
use rtrb::Consumer;

/// How many words are taken from a ring at a time.
const BATCH: usize = 4096;

/// A ring's entries, first to last.
pub(super) struct Queue {
    pub(super) thread: u32,
    /// The time of the entry before: a thread's time does not go back.
    pub(super) last: u64,
    ring: Ring,
    batch: Vec<u64>,
    /// Where the first entry that was not taken begins in the batch.
    at: usize,
}

enum Ring {
    Words(Consumer<u64>),
    #[cfg(feature = "events")]
    Events(events::Reader),
}

impl Queue {
    pub(super) fn new(thread: u32, ring: Consumer<u64>) -> Self {
        Self::of(thread, Ring::Words(ring))
    }

    #[cfg(feature = "events")]
    pub(super) fn of_events(events: events::Reader) -> Self {
        Self::of(events.number(), Ring::Events(events))
    }

    fn of(thread: u32, ring: Ring) -> Self {
        Self {
            thread,
            last: 0,
            ring,
            batch: Vec::with_capacity(BATCH),
            at: 0,
        }
    }

    /// The time stamp of the first entry, if there is any.
    pub(super) fn stamp(&mut self) -> Option<u64> {
        if self.first().is_none() {
            self.refill();
        }
        self.first().map(|entry| entry[1])
    }

    /// The first entry, if the batch has it as a whole.
    pub(super) fn first(&self) -> Option<&[u64]> {
        let rest = &self.batch[self.at..];
        let words = Head(*rest.first()?).words();
        rest.get(..words)
    }

    /// Goes on behind the first entry.
    pub(super) fn advance(&mut self) {
        self.at += self.first().map_or(0, <[u64]>::len);
    }

    fn refill(&mut self) {
        self.batch.drain(..self.at);
        self.at = 0;
        let room = BATCH - self.batch.len();
        match &mut self.ring {
            Ring::Words(ring) => {
                let words = ring.slots().min(room);
                // At least `words` are available, as `slots` reported.
                if let Ok(chunk) = ring.read_chunk(words) {
                    let (first, second) = chunk.as_slices();
                    self.batch.extend_from_slice(first);
                    self.batch.extend_from_slice(second);
                    chunk.commit_all();
                }
            }
            #[cfg(feature = "events")]
            Ring::Events(events) => {
                let before = self.batch.len();
                events.take(&mut self.batch, room / 4);
                let head = Head::new(Head::EVENT, 4, 0);
                let heads = self.batch[before..].iter_mut().step_by(4);
                heads.for_each(|word| *word |= head.0);
            }
        }
    }

    /// Whether its thread has ended, and nothing is left.
    pub(super) fn is_over(&self) -> bool {
        let is_over = match &self.ring {
            // In this order: what was written before the end is seen.
            Ring::Words(ring) => ring.is_abandoned() && ring.is_empty(),
            #[cfg(feature = "events")]
            Ring::Events(events) => events.is_over(),
        };
        is_over && self.at == self.batch.len()
    }
}

/// Calls `take` with the queue that has the oldest first entry, until no queue has an entry at or
/// before `limit`.
pub(super) fn merge(queues: &mut [Queue], limit: u64, mut take: impl FnMut(&mut Queue)) {
    loop {
        let mut oldest = None;
        // Until here the oldest queue stays the oldest.
        let mut next = limit;
        for (index, queue) in queues.iter_mut().enumerate() {
            let Some(stamp) = queue.stamp().filter(|stamp| *stamp <= limit) else {
                continue;
            };
            match oldest {
                Some((_, before)) if stamp >= before => next = next.min(stamp),
                _ => {
                    next = oldest.map_or(next, |(_, before)| next.min(before));
                    oldest = Some((index, stamp));
                }
            }
        }
        let Some((index, _)) = oldest else { return };
        let queue = &mut queues[index];
        while queue.first().is_some_and(|entry| entry[1] <= next) {
            take(queue);
            queue.advance();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rtrb::{Producer, RingBuffer};

    fn entry(stamp: u64, words: usize) -> Vec<u64> {
        let mut entry = vec![Head::new(Head::SAMPLE, words, 7).0, stamp];
        entry.resize(words, stamp);
        entry
    }

    fn ring(thread: u32) -> (Producer<u64>, Queue) {
        let (producer, consumer) = RingBuffer::new(1 << 16);
        (producer, Queue::new(thread, consumer))
    }

    proptest! {
        #[test]
        fn entries_of_all_queues_come_by_time_and_none_is_missing(
            steps in prop::collection::vec((0usize..4, 0u64..20, 2usize..60), 0..800),
            limit in 0u64..4000,
        ) {
            let (mut producers, mut queues): (Vec<_>, Vec<_>) = (0..4).map(ring).unzip();
            let mut stamps = [0; 4];
            let mut expected = 0;
            for (queue, step, words) in steps {
                stamps[queue] += step;
                producers[queue].push_entire_slice(&entry(stamps[queue], words)).unwrap();
                expected += usize::from(stamps[queue] <= limit);
            }
            let mut last = 0;
            let mut seen = 0;
            merge(&mut queues, limit, |queue| {
                let entry = queue.first().unwrap();
                assert!(entry[1] >= last && entry[1] <= limit);
                assert!(entry[2..].iter().all(|word| *word == entry[1]));
                last = entry[1];
                seen += 1;
            });
            prop_assert_eq!(seen, expected);
            drop(producers);
            let whole = queues.iter_mut().all(|queue| queue.stamp().is_none() == queue.is_over());
            prop_assert!(whole);
        }
    }
}
