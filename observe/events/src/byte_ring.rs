//! The ring between a recorded process and the thread that writes the recording: one producer, one
//! consumer, both non-blocking.

use luna_platform::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::OnceLock;

/// A ring of bytes. An event that does not fit is lost, and so are all later ones, since a reader
/// could not assign them.
///
/// Real-time path: yes, for the producer: wait-free, O(bytes), no allocation.
///
/// ```
/// use luna_events::ByteRing;
///
/// let ring = ByteRing::new(4);
/// ring.put(&[1, 2], &[3]);
/// ring.put(&[4, 5], &[]);
/// let mut taken = Vec::new();
/// ring.take(&mut taken, 9);
/// assert_eq!((taken, ring.counts()), (vec![1, 2, 3], (1, 1)));
/// ```
#[derive(Debug)]
pub struct ByteRing {
    bytes: Box<[AtomicU8]>,
    /// The number of bytes ever written, and ever read.
    written: AtomicU64,
    read: AtomicU64,
    events: AtomicU64,
    lost: AtomicU64,
    is_final: AtomicBool,
    outside: OnceLock<&'static str>,
}

impl ByteRing {
    /// A ring with room for so many bytes. Allocates.
    pub fn new(room: usize) -> Self {
        Self {
            bytes: (0..room).map(|_| AtomicU8::new(0)).collect(),
            written: AtomicU64::new(0),
            read: AtomicU64::new(0),
            events: AtomicU64::new(0),
            lost: AtomicU64::new(0),
            is_final: AtomicBool::new(false),
            outside: OnceLock::new(),
        }
    }

    /// Puts an event in, in two parts, or counts it as lost. By the one producer; wait-free,
    /// O(bytes).
    pub fn put(&self, head: &[u8], tail: &[u8]) {
        let lost = self.lost.load(Ordering::Relaxed);
        let written = self.written.load(Ordering::Relaxed);
        let used = written - self.read.load(Ordering::Acquire);
        let length = (head.len() + tail.len()) as u64;
        if lost > 0 || length > self.bytes.len() as u64 - used {
            self.lost.store(lost + 1, Ordering::Relaxed);
            return;
        }
        for (at, &byte) in (written..).zip(head.iter().chain(tail)) {
            self.bytes[self.index(at)].store(byte, Ordering::Relaxed);
        }
        let events = self.events.load(Ordering::Relaxed);
        self.events.store(events + 1, Ordering::Relaxed);
        self.written.store(written + length, Ordering::Release);
    }

    fn index(&self, at: u64) -> usize {
        (at % self.bytes.len() as u64) as usize
    }

    /// Counts an event that could not be recorded as lost.
    pub fn lose(&self) {
        let lost = self.lost.load(Ordering::Relaxed);
        self.lost.store(lost + 1, Ordering::Relaxed);
    }

    /// Ends the stream: the producer puts in nothing more.
    pub fn close(&self) {
        self.is_final.store(true, Ordering::Release);
    }

    /// Whether the stream has ended.
    pub fn is_closed(&self) -> bool {
        self.is_final.load(Ordering::Acquire)
    }

    /// Notes a construct that is not recorded. By the one producer; the first is kept.
    pub fn note_outside(&self, construct: &'static str) {
        // There is one producer, so this never waits.
        let _ = self.outside.set(construct);
    }

    /// The first construct that is not recorded.
    pub fn outside(&self) -> Option<&'static str> {
        self.outside.get().copied()
    }

    /// Takes up to `most` bytes out. By the one consumer.
    pub fn take(&self, into: &mut Vec<u8>, most: usize) {
        let read = self.read.load(Ordering::Relaxed);
        let written = self.written.load(Ordering::Acquire);
        let until = written.min(read + most as u64);
        into.extend((read..until).map(|at| self.bytes[self.index(at)].load(Ordering::Relaxed)));
        self.read.store(until, Ordering::Release);
    }

    /// How many events were put in, and how many were lost.
    pub fn counts(&self) -> (u64, u64) {
        (
            self.events.load(Ordering::Relaxed),
            self.lost.load(Ordering::Relaxed),
        )
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn what_goes_in_comes_out_in_order_across_the_end() {
        let ring = ByteRing::new(7);
        let (mut sent, mut taken) = (Vec::new(), Vec::new());
        for number in 0..100_u8 {
            ring.put(&[number], &[number, 255 - number]);
            sent.extend([number, number, 255 - number]);
            ring.take(&mut taken, 5);
        }
        assert_eq!(taken, sent);
        assert_eq!(ring.counts(), (100, 0));
    }

    #[test]
    fn what_does_not_fit_is_counted_and_all_that_comes_after() {
        let ring = ByteRing::new(4);
        ring.put(&[1, 2], &[3]);
        ring.put(&[4, 5], &[]);
        let mut taken = Vec::new();
        ring.take(&mut taken, 9);
        ring.put(&[6], &[]);
        ring.take(&mut taken, 9);
        assert_eq!(taken, [1, 2, 3]);
        assert_eq!(ring.counts(), (1, 2));
    }

    #[test]
    fn two_threads() {
        let ring = ByteRing::new(64);
        let mut taken = Vec::new();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                (0..=255).for_each(|number| ring.put(&[number], &[]));
                ring.close();
            });
            loop {
                let is_closed = ring.is_closed();
                ring.take(&mut taken, 16);
                let (events, _) = ring.counts();
                if is_closed && taken.len() as u64 == events {
                    break;
                }
            }
        });
        let (events, lost) = ring.counts();
        assert_eq!(events + lost, 256);
        assert!(taken.iter().copied().eq((0..=255).take(events as usize)));
    }
}

#[cfg(all(test, loom))]
mod model {
    use super::*;
    use luna_platform::sync::Arc;

    /// In any interleaving, the bytes come out in order and in whole events, and lost events are
    /// counted.
    #[test]
    fn events_come_out_whole_and_in_order_and_lost_ones_are_counted() {
        loom::model(|| {
            let ring = Arc::new(ByteRing::new(3));
            let producer = ring.clone();
            let thread = loom::thread::spawn(move || {
                producer.put(&[1], &[2]);
                producer.put(&[3], &[4]);
                producer.put(&[5], &[]);
                producer.close();
            });
            let mut taken = Vec::new();
            ring.take(&mut taken, 2);
            ring.take(&mut taken, 2);
            thread.join().unwrap();
            assert!(ring.is_closed());
            ring.take(&mut taken, 9);
            let (events, lost) = ring.counts();
            assert_eq!(events + lost, 3);
            // From the first lost one on nothing is kept.
            let whole: &[u8] = match events {
                1 => &[1, 2],
                2 => &[1, 2, 3, 4],
                3 => &[1, 2, 3, 4, 5],
                _ => panic!("the first one fits"),
            };
            assert_eq!(taken, whole);
        });
    }

    /// A reader that sees the ring closed sees all that was put in before, and what was lost.
    #[test]
    fn one_that_sees_the_end_sees_all() {
        loom::model(|| {
            let ring = Arc::new(ByteRing::new(2));
            let producer = ring.clone();
            let thread = loom::thread::spawn(move || {
                producer.put(&[1], &[]);
                producer.put(&[2, 3], &[]);
                producer.close();
            });
            let mut taken = Vec::new();
            if ring.is_closed() {
                ring.take(&mut taken, 9);
                assert_eq!((taken, ring.counts()), (vec![1], (1, 1)));
            }
            thread.join().unwrap();
        });
    }
}
