//! The store of violations found on the path: of fixed size, without locks.
//!
//! A slot is used once in a program's run, so that a writer never meets a reader: a new scope
//! leaves the slots of earlier ones alone.

use crate::Kind;
use std::cell::UnsafeCell;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

/// How deep a backtrace is kept.
const DEPTH: usize = 64;
/// The limit of different violations stored for one scope; further ones are counted.
const MAX_PER_SCOPE: usize = 64;
/// How many a program keeps.
const SLOTS: usize = 1024;

/// A violation as it is noted.
#[derive(Clone, Copy)]
pub(crate) struct Raw {
    pub(crate) kind: Kind,
    /// 0 for none.
    pub(crate) process: u32,
    /// As `watch` numbers them.
    pub(crate) thread: usize,
    addresses: [usize; DEPTH],
    depth: usize,
}

impl Raw {
    /// A violation with its backtrace.
    ///
    /// Allocates nothing and takes no lock, so that it can be created anywhere; with glibc 2.35 or
    /// later the unwinder finds its tables without a lock.
    pub(crate) fn here(kind: Kind, process: u32, thread: usize) -> Self {
        let mut raw = Self {
            kind,
            process,
            thread,
            addresses: [0; DEPTH],
            depth: 0,
        };
        // SAFETY: the unsynchronized function must not run beside symbolization, which matters only
        // on other systems; on Linux and Unix it may be called from any thread.
        unsafe {
            backtrace::trace_unsynchronized(|frame| {
                raw.addresses[raw.depth] = frame.ip().addr();
                raw.depth += 1;
                raw.depth < DEPTH
            });
        }
        raw
    }

    /// The way there, the innermost first.
    pub(crate) fn addresses(&self) -> &[usize] {
        &self.addresses[..self.depth]
    }

    fn is_same(&self, other: &Raw) -> bool {
        self.kind == other.kind
            && self.process == other.process
            && self.thread == other.thread
            && self.addresses() == other.addresses()
    }
}

/// # Invariants
///
/// `raw` is written once, before `is_written`, by the thread that took the slot's number, and read
/// only after it.
struct Slot {
    is_written: AtomicBool,
    times: AtomicU64,
    raw: UnsafeCell<Raw>,
}

// SAFETY: the type's invariant.
unsafe impl Sync for Slot {}

impl Slot {
    const fn empty() -> Self {
        Slot {
            is_written: AtomicBool::new(false),
            times: AtomicU64::new(0),
            raw: UnsafeCell::new(Raw {
                kind: Kind::Free { bytes: 0 },
                process: 0,
                thread: 0,
                addresses: [0; DEPTH],
                depth: 0,
            }),
        }
    }

    fn read(&self) -> Option<&Raw> {
        // SAFETY: `is_written` is set, so by the invariant `raw` is not written any more.
        self.is_written
            .load(Ordering::Acquire)
            .then(|| unsafe { &*self.raw.get() })
    }
}

static ROOM: [Slot; SLOTS] = [const { Slot::empty() }; SLOTS];
/// The slots that were given out; may go beyond their number.
static TAKEN: AtomicUsize = AtomicUsize::new(0);
/// The first slot of the present scope.
static FIRST: AtomicUsize = AtomicUsize::new(0);
/// The number of violations in the present scope, including repeated ones.
static SEEN: AtomicUsize = AtomicUsize::new(0);
static IS_OPEN: AtomicBool = AtomicBool::new(false);

/// Whether violations are noted.
#[inline]
pub(crate) fn is_open() -> bool {
    IS_OPEN.load(Ordering::Relaxed)
}

/// How many violations there were since the room was opened.
pub(crate) fn seen() -> usize {
    SEEN.load(Ordering::Acquire)
}

/// Notes from now on. One scope at a time.
pub(crate) fn open() {
    FIRST.store(TAKEN.load(Ordering::Relaxed), Ordering::Relaxed);
    SEEN.store(0, Ordering::Relaxed);
    IS_OPEN.store(true, Ordering::SeqCst);
}

/// Ends the noting; returns the violations, each with its count.
pub(crate) fn close() -> Vec<(Raw, u64)> {
    IS_OPEN.store(false, Ordering::SeqCst);
    let first = FIRST.load(Ordering::Relaxed).min(SLOTS);
    let taken = TAKEN.load(Ordering::Relaxed).min(SLOTS);
    ROOM[first..taken]
        .iter()
        .filter_map(|slot| Some((*slot.read()?, slot.times.load(Ordering::Relaxed))))
        .collect()
}

/// Notes a violation. Bounded, lock-free, no allocation; async-signal-safe.
pub(crate) fn note(raw: &Raw) {
    let first = FIRST.load(Ordering::Relaxed);
    let taken = TAKEN.load(Ordering::Relaxed);
    let known = &ROOM[first.min(SLOTS)..taken.min(SLOTS)];
    let same = known
        .iter()
        .find(|slot| slot.read().is_some_and(|other| other.is_same(raw)));
    if let Some(slot) = same {
        slot.times.fetch_add(1, Ordering::Relaxed);
    } else if taken - first < MAX_PER_SCOPE
        && let Some(slot) = ROOM.get(TAKEN.fetch_add(1, Ordering::Relaxed))
    {
        // SAFETY: the number was given only to this caller, and by the invariant the slot is not
        // read before `is_written` is set.
        unsafe { *slot.raw.get() = *raw };
        slot.times.store(1, Ordering::Relaxed);
        slot.is_written.store(true, Ordering::Release);
    }
    SEEN.fetch_add(1, Ordering::Release);
}
