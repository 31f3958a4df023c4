//! The event ring of a thread: one producer, one consumer, both non-blocking.

#[cfg(not(loom))]
use luna_core::events::Trace;
#[cfg(not(loom))]
use luna_machine::counter::Counter;
use luna_platform::clock::Instant;
use luna_platform::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use luna_platform::sync::{Arc, UnsafeCell};
use std::cell::Cell;

/// A model has none.
#[cfg(loom)]
#[derive(Debug, Clone, Copy)]
pub enum Counter {}

#[cfg(loom)]
impl Counter {
    fn read(self) -> u64 {
        match self {}
    }
}

/// Codes up to here are events.
const MAX_CODE: u16 = 0xFEFF;

/// An event in the ring: code and subject, time stamp, two numbers.
type Entry = [u64; 4];

/// The number of events that were lost because the ring was full.
#[derive(Debug, Clone)]
pub struct Losses(Arc<AtomicU64>);

impl Losses {
    /// How many events were lost until now.
    pub fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// # Invariants
///
/// `tail` and `limit` belong to the writer. An entry between `read` and `written` is the reader's,
/// any other the writer's.
struct Ring {
    /// How many entries were ever written.
    tail: Cell<usize>,
    /// The number of entries up to which there is room, as far as the writer knows.
    limit: Cell<usize>,
    mask: usize,
    entries: Box<[UnsafeCell<Entry>]>,
    counter: Option<Counter>,
    number: u32,
    /// The listener to the names beside it; 0 is none.
    whose: u64,
    lost: Arc<AtomicU64>,
    has_writer: AtomicBool,
    has_reader: AtomicBool,
    written: Apart,
    read: Apart,
}

/// On a cache line of its own, since another core writes it.
#[repr(align(128))]
struct Apart(AtomicUsize);

// SAFETY: by the invariant each side accesses its own entries and cells, and shared fields are
// atomic.
unsafe impl Sync for Ring {}
// SAFETY: the rules of `Sync` hold whichever thread has the ring: the writer's cells go with the
// one writer. Its drop frees the entries, and reads no cell.
unsafe impl Send for Ring {}

/// A ring with room for `room` events, rounded up to a power of two, of the thread or executor with
/// this number in its recording. Times are the counter's ticks, or without one the thread's clock's
/// nanoseconds. Allocates, and touches each page.
pub fn ring(room: usize, number: u32, counter: Option<Counter>) -> (Writer, Reader) {
    ring_of(0, room, number, counter)
}

/// As [`ring`], for this listener to names.
pub(crate) fn ring_of(
    whose: u64,
    room: usize,
    number: u32,
    counter: Option<Counter>,
) -> (Writer, Reader) {
    let room = room.clamp(2, 1 << 26).next_power_of_two();
    let lost = Arc::new(AtomicU64::new(0));
    let ring = Arc::new(Ring {
        tail: Cell::new(0),
        limit: Cell::new(room),
        mask: room - 1,
        // Not zeroes: the system would map those lazily.
        entries: (0..room).map(|_| UnsafeCell::new([!0; 4])).collect(),
        counter,
        number,
        whose,
        lost,
        has_writer: AtomicBool::new(true),
        has_reader: AtomicBool::new(true),
        written: Apart(AtomicUsize::new(0)),
        read: Apart(AtomicUsize::new(0)),
    });
    (Writer(ring.clone()), Reader(ring))
}

impl Ring {
    /// Puts an event in, or counts it as lost. False if it was lost and there is no reader any
    /// more. Wait-free, O(1).
    ///
    /// # Safety
    ///
    /// The caller is the one writer's thread.
    #[inline]
    unsafe fn put(&self, head: u64, arguments: [u64; 2]) -> bool {
        let tail = self.tail.get();
        if tail == self.limit.get() && !self.finds_room(tail) {
            return self.lose(head);
        }
        let stamp = match self.counter {
            Some(counter) => counter.read(),
            None => Instant::now().as_nanos(),
        };
        let place = &self.entries[tail & self.mask];
        // SAFETY: there is room, so by the invariant the entry is the writer's, and the caller is
        // the writer's thread.
        place.with_mut(|place| unsafe { *place = [head, stamp, arguments[0], arguments[1]] });
        self.tail.set(tail.wrapping_add(1));
        // Release: a reader of the count sees the entry.
        self.written
            .0
            .store(tail.wrapping_add(1), Ordering::Release);
        true
    }

    #[cold]
    fn finds_room(&self, tail: usize) -> bool {
        // Acquire: the reader is done with the entries that it has counted as read.
        let read = self.read.0.load(Ordering::Acquire);
        self.limit.set(read.wrapping_add(self.entries.len()));
        tail != self.limit.get()
    }

    #[cold]
    fn lose(&self, head: u64) -> bool {
        // A part of a name is no event.
        if (head >> 16) as u16 <= MAX_CODE {
            // Only the writer counts.
            let lost = self.lost.load(Ordering::Relaxed);
            self.lost.store(lost + 1, Ordering::Relaxed);
        }
        self.has_reader.load(Ordering::Relaxed)
    }
}

/// The writing end of a ring.
pub struct Writer(Arc<Ring>);

impl Writer {
    /// Puts an event in, for a thread that has no ring itself. Returns whether there is still a
    /// reader, as far as is known.
    pub fn put(&mut self, of: u16, subject: u32, arguments: [u64; 2]) -> bool {
        let head = u64::from(subject) << 32 | u64::from(of) << 16;
        // SAFETY: `self` is borrowed exclusively, so this is the one writer.
        unsafe { self.0.put(head, arguments) }
    }
}

/// What a thread has that is traced.
#[cfg(not(loom))]
struct OfThread(Writer);

#[cfg(not(loom))]
impl Trace for OfThread {
    #[inline]
    fn put(&self, code: u16, subject: u32, arguments: [u64; 2]) -> bool {
        let head = u64::from(subject) << 32 | u64::from(code) << 16;
        // SAFETY: the trace owns the one writer, and is called on one thread at a time.
        unsafe { self.0.0.put(head, arguments) }
    }

    fn place(&self) -> (u64, u32) {
        (self.0.0.whose, self.0.0.number)
    }
}

/// From now on the calling thread's events go to this ring. Allocates.
///
/// ```
/// use luna_events::{self as events, Kind, code};
///
/// let (writer, mut reader) = events::ring(16, 0, None);
/// events::attach(writer);
/// events::report(code::SLOT, 7, || [41, 250]);
/// assert!(events::is_on());
/// events::detach();
/// let mut words = Vec::new();
/// reader.take(&mut words, 16);
/// assert_eq!((words[0], &words[2..]), (7 << 32 | u64::from(code::SLOT) << 16, &[41, 250][..]));
/// assert!(reader.is_over());
/// ```
#[cfg(not(loom))]
pub fn attach(writer: Writer) {
    luna_core::events::attach(Box::new(OfThread(writer)));
}

impl Drop for Writer {
    fn drop(&mut self) {
        self.0.has_writer.store(false, Ordering::Release);
    }
}

luna_platform::debug_fields!(Writer, |writer| number: writer.0.number);

/// The reading end of a ring.
pub struct Reader(Arc<Ring>);

impl Reader {
    /// The number of the thread or executor.
    pub fn number(&self) -> u32 {
        self.0.number
    }

    /// The counter of its lost events.
    pub fn losses(&self) -> Losses {
        Losses(self.0.lost.clone())
    }

    /// Moves up to `most` events out, each as four words: the code in bits 16 to 31 and the subject
    /// above, the time stamp, and two numbers.
    pub fn take(&mut self, into: &mut Vec<u64>, most: usize) {
        let ring = &*self.0;
        let read = ring.read.0.load(Ordering::Relaxed);
        // Acquire: the counted entries are visible.
        let written = ring.written.0.load(Ordering::Acquire);
        let taken = written.wrapping_sub(read).min(most);
        for at in 0..taken {
            let place = &ring.entries[read.wrapping_add(at) & ring.mask];
            // SAFETY: the entry was written and not read, so by the invariant it is the reader's.
            into.extend_from_slice(&place.with(|place| unsafe { *place }));
        }
        // Release: the reader is done with them.
        ring.read
            .0
            .store(read.wrapping_add(taken), Ordering::Release);
    }

    /// Whether the writer was dropped, and no event is left.
    pub fn is_over(&self) -> bool {
        let ring = &*self.0;
        // In this order: entries that were written before the end are seen.
        !ring.has_writer.load(Ordering::Acquire)
            && ring.written.0.load(Ordering::Relaxed) == ring.read.0.load(Ordering::Relaxed)
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.0.has_reader.store(false, Ordering::Relaxed);
    }
}

luna_platform::debug_fields!(Reader, |reader| number: reader.0.number);

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn what_finds_no_room_is_counted_and_the_rest_comes_in_order() {
        let (mut writer, mut reader) = ring(5, 3, None);
        let losses = reader.losses();
        let mut taken = Vec::new();
        for number in 0..30 {
            writer.put(0, number, [number.into(), 7]);
            if number % 10 == 9 {
                reader.take(&mut taken, 100);
            }
        }
        // Eight at a time, of ten.
        assert_eq!(losses.get(), 6);
        let numbers: Vec<u64> = taken.chunks(4).map(|entry| entry[2]).collect();
        let expected = (0..30).filter(|number| number % 10 < 8);
        assert!(expected.eq(numbers));
        assert!(
            taken
                .chunks(4)
                .all(|entry| entry[0] >> 32 == entry[2] && entry[3] == 7)
        );
        assert!(!reader.is_over());
        drop(writer);
        assert!(reader.is_over());
    }

    #[test]
    fn a_writer_learns_that_nobody_reads_when_it_is_full() {
        let (mut writer, reader) = ring(2, 0, None);
        drop(reader);
        let mut put = || writer.put(0, 0, [0, 0]);
        assert!(put() && put());
        assert!(!put());
    }

    #[test]
    fn two_threads_lose_none_unseen() {
        let (mut writer, mut reader) = ring(64, 0, None);
        let losses = reader.losses();
        let mut taken = Vec::new();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                for number in 0..10_000 {
                    writer.put(0, 0, [number, !number]);
                }
            });
            while !reader.is_over() {
                reader.take(&mut taken, 16);
            }
        });
        assert_eq!(taken.len() as u64 / 4 + losses.get(), 10_000);
        assert!(taken.chunks(4).all(|entry| entry[2] == !entry[3]));
        assert!(taken.chunks(4).is_sorted_by(|one, next| one[2] < next[2]));
    }
}

#[cfg(all(test, loom))]
mod model {
    use super::*;

    /// In any interleaving, events are read whole and in order, and the others are counted.
    #[test]
    fn events_come_out_whole_and_in_order_and_lost_ones_are_counted() {
        loom::model(|| {
            let (mut writer, mut reader) = ring(2, 0, None);
            let losses = reader.losses();
            let thread = loom::thread::spawn(move || {
                for number in 1..=3 {
                    writer.put(0, number, [number.into(), number.into()]);
                }
            });
            let mut taken = Vec::new();
            reader.take(&mut taken, 1);
            reader.take(&mut taken, 1);
            let was_over = reader.is_over();
            thread.join().unwrap();
            assert!(!was_over || taken.len() as u64 / 4 + losses.get() == 3);
            reader.take(&mut taken, 9);
            assert!(reader.is_over());
            let numbers: Vec<u64> = taken.chunks(4).map(|entry| entry[2]).collect();
            let is_whole = |entry: &[u64]| entry[0] == entry[2] << 32 && entry[2] == entry[3];
            assert!(taken.chunks(4).all(is_whole));
            assert!(numbers.is_sorted());
            assert_eq!(numbers.len() as u64 + losses.get(), 3);
        });
    }
}
