//! A thread's rings: the writing end, which the real-time path uses.
//!
//! ```text
//!   record ── time stamp ── entry ──> ring of samples  ──> recorder
//!   message ── text on the stack ──> ring of messages ──>
//! ```
//!
//! An entry is a few words: a head with its kind and length, a time stamp, and the rest. It is
//! written completely or dropped. Samples and messages have separate rings, so that a burst of one
//! does not cost the other.

use crate::hub::{Hub, Rooms, Stamp};
use crate::registry::Losses;
use crate::sample::Sample;
use luna_core::current;
use rtrb::{Consumer, Producer, RingBuffer};
use std::cell::{Cell, RefCell, UnsafeCell};
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The most words of an entry.
pub(crate) const MAX_WORDS: usize = 64;

/// The first word of an entry: its kind (8 bits), its number of words (8 bits), an event's code (16
/// bits), and a signal's number (the upper 32).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Head(pub(crate) u64);

impl Head {
    pub(crate) const SAMPLE: u8 = 1;
    pub(crate) const MESSAGE: u8 = 2;
    #[cfg(feature = "events")]
    pub(crate) const EVENT: u8 = 3;

    pub(crate) fn new(kind: u8, words: usize, signal: u32) -> Self {
        debug_assert!(words <= MAX_WORDS);
        Self(u64::from(kind) | (words as u64) << 8 | u64::from(signal) << 32)
    }

    pub(crate) fn kind(self) -> u8 {
        self.0 as u8
    }

    pub(crate) fn words(self) -> usize {
        usize::from((self.0 >> 8) as u8)
    }

    pub(crate) fn signal(self) -> u32 {
        (self.0 >> 32) as u32
    }

    /// An event's code; its subject is in the place of a sample's signal.
    #[cfg(feature = "events")]
    pub(crate) fn code(self) -> u16 {
        (self.0 >> 16) as u16
    }
}

/// The writing end of a thread's rings.
pub(crate) struct Lane {
    hub: Arc<Hub>,
    #[cfg(feature = "events")]
    number: u32,
    stamp: Stamp,
    samples: Ring,
    messages: Ring,
    lost_messages: Arc<AtomicU64>,
}

/// A ring's writing end.
///
/// # Invariants
///
/// Only the thread that owns the lane accesses it, and nothing called during an access does so
/// again.
struct Ring(UnsafeCell<Producer<u64>>);

impl Ring {
    /// Whether there was room. Wait-free, O(words).
    #[inline(always)]
    fn push(&self, entry: &[u64]) -> bool {
        // SAFETY: by the invariant above no other reference exists during this call.
        let producer = unsafe { &mut *self.0.get() };
        // Only this thread pushes, so free space stays free. The reader's position is read only if
        // its cached copy does not suffice.
        if producer.cached_slots() < entry.len() && producer.slots() < entry.len() {
            return false;
        }
        // Word by word: a third of the instructions of a chunk. The reader may see a part of an
        // entry; it waits for the rest.
        let pushed = entry.iter().all(|word| producer.push(*word).is_ok());
        debug_assert!(pushed, "there was room");
        true
    }
}

/// The reading end of a thread's rings, for the recorder.
pub(crate) struct Inlet {
    pub(crate) number: u32,
    pub(crate) name: String,
    pub(crate) samples: Consumer<u64>,
    pub(crate) messages: Consumer<u64>,
    pub(crate) lost_messages: Arc<AtomicU64>,
}

/// What the calling thread is called, which has this number.
pub(crate) fn thread_name(number: u32) -> String {
    let thread = std::thread::current();
    let name = thread.name().map(str::to_owned);
    name.unwrap_or_else(|| format!("thread {number}"))
}

thread_local! {
    /// The lane that this thread used last: null, or one that it owns.
    static LANE: Cell<*const Lane> = const { Cell::new(ptr::null()) };
    static OWNED: RefCell<Owned> = const { RefCell::new(Owned(Vec::new())) };
}

/// The lanes of a thread, one a hub.
#[expect(clippy::vec_box, reason = "`LANE` points to one while others come")]
struct Owned(Vec<Box<Lane>>);

impl Drop for Owned {
    fn drop(&mut self) {
        LANE.set(ptr::null());
    }
}

impl Lane {
    /// Creates a ring, and touches each page of its memory.
    fn ring(words: usize) -> (Producer<u64>, Consumer<u64>) {
        let (mut producer, mut consumer) = RingBuffer::new(words.max(MAX_WORDS));
        let whole = producer.buffer().capacity();
        if let Ok(chunk) = producer.write_chunk(whole) {
            chunk.commit_all();
        }
        if let Ok(chunk) = consumer.read_chunk(whole) {
            chunk.commit_all();
        }
        (producer, consumer)
    }

    fn make(hub: &Arc<Hub>) -> Option<Box<Lane>> {
        let mut made = None;
        let is_heard = hub.add_lane(
            |number,
             Rooms {
                 samples, messages, ..
             }| {
                let (samples, samples_out) = Self::ring(samples);
                let (messages, messages_out) = Self::ring(messages);
                let lost_messages = Arc::<AtomicU64>::default();
                made = Some(Box::new(Lane {
                    hub: hub.clone(),
                    #[cfg(feature = "events")]
                    number,
                    stamp: hub.stamp(),
                    samples: Ring(UnsafeCell::new(samples)),
                    messages: Ring(UnsafeCell::new(messages)),
                    lost_messages: lost_messages.clone(),
                }));
                let name = thread_name(number);
                Inlet {
                    number,
                    name,
                    samples: samples_out,
                    messages: messages_out,
                    lost_messages,
                }
            },
        );
        made.filter(|_| is_heard)
    }

    #[inline(always)]
    fn is_of(&self, hub: &Arc<Hub>) -> bool {
        Arc::ptr_eq(&self.hub, hub)
    }

    #[inline(always)]
    fn sample(&self, head: Head, losses: &Losses, value: impl Sample) {
        let stamp = self.stamp.now();
        if !value.with_entry([head.0, stamp], |entry| self.samples.push(entry)) {
            losses.count();
        }
    }
}

/// Creates the calling thread's rings for `hub`, if it has none. Not for the real-time path.
pub(crate) fn prepare(hub: &Arc<Hub>) {
    with_lane(hub, |_| ());
}

/// The number of the calling thread's lane.
#[cfg(feature = "events")]
pub(crate) fn number(hub: &Arc<Hub>) -> Option<u32> {
    with_lane(hub, |lane| lane.number)
}

/// Records a sample. Wait-free, O(elements).
#[inline(always)]
pub(crate) fn sample(hub: &Arc<Hub>, head: Head, losses: &Losses, value: impl Sample) {
    let lane = LANE.get();
    if !lane.is_null() {
        // SAFETY: it points to a lane of this thread; a lane is dropped only when `LANE` does not
        // point to it.
        let lane = unsafe { &*lane };
        if lane.is_of(hub) {
            lane.sample(head, losses, value);
            return;
        }
    }
    sample_elsewhere(hub, head, losses, value);
}

#[cold]
#[inline(never)]
fn sample_elsewhere(hub: &Arc<Hub>, head: Head, losses: &Losses, value: impl Sample) {
    if with_lane(hub, |lane| lane.sample(head, losses, value)).is_none() {
        losses.count();
    }
}

/// The hub of the rings that this thread used last, if it records.
pub(crate) fn hub_of_lane() -> Option<Arc<Hub>> {
    let lane = LANE.get();
    if lane.is_null() {
        return None;
    }
    // SAFETY: as in `sample`.
    let hub = unsafe { &(*lane).hub };
    hub.is_recording().then(|| hub.clone())
}

/// Records a message; `fill` makes its entry from the time stamp. Wait-free except for `fill`.
pub(crate) fn message<'a>(hub: &Arc<Hub>, fill: impl FnOnce(u64) -> &'a [u64]) {
    let push = |lane: &Lane| {
        let entry = fill(lane.stamp.now());
        if !lane.messages.push(entry) {
            lane.lost_messages.fetch_add(1, Ordering::Relaxed);
        }
    };
    if with_lane(hub, push).is_none() {
        hub.lost_messages.fetch_add(1, Ordering::Relaxed);
    }
}

/// Calls `f` with this thread's lane of `hub`, which is created if needed, but not on the real-time
/// path. None if there is no lane.
fn with_lane<R>(hub: &Arc<Hub>, f: impl FnOnce(&Lane) -> R) -> Option<R> {
    // The thread may be about to end.
    OWNED
        .try_with(|owned| {
            let mut owned = owned.try_borrow_mut().ok()?;
            if !owned.0.iter().any(|lane| lane.is_of(hub)) {
                if current::on_path() {
                    return None;
                }
                LANE.set(ptr::null());
                // Drop the lanes of hubs that do not record any more.
                owned.0.retain(|lane| lane.hub.is_recording());
                owned.0.push(Lane::make(hub)?);
            }
            let lane = owned.0.iter().find(|lane| lane.is_of(hub))?;
            LANE.set(&raw const **lane);
            Some(f(lane))
        })
        .ok()
        .flatten()
}
