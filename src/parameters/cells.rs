//! What the real-time path sees: the words of parameters, and which thread may change which of them
//! when.

use crate::replay;
use luna_core::current;
use luna_core::latest_slots::{LatestSlots, SlotMemory};
use luna_platform::lock::PiLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Weak};

/// The parameters of a process, which it takes all together.
pub(crate) struct Reader {
    /// The process: 0 is none.
    pub(super) process: u32,
    pub(super) name: Arc<str>,
    pub(super) slots: LatestSlots,
    /// What was declared for its process, for recordings. All of it before the process runs.
    pub(super) cells: PiLock<Vec<Weak<Cells>>>,
}

/// The words of a parameter in a process, once in each slot.
pub(super) struct Cells {
    pub(super) reader: Arc<Reader>,
    /// What it is called in recordings.
    pub(super) name: Arc<str>,
    /// Which entry of the store.
    pub(super) entry: usize,
    words: SlotMemory<AtomicU64>,
}

impl Reader {
    /// Takes the latest values, if it is the reader's process that asks. Wait-free; O(1), in a
    /// process that is recorded O(words).
    #[inline]
    pub(crate) fn latch(&self) {
        if is_current(self.process) {
            match current::has_replay_log() {
                false => drop(self.slots.latch()),
                true => self.latch_with_log(),
            }
        }
    }

    /// Latches a set that is recorded or replayed.
    #[cold]
    fn latch_with_log(&self) {
        if !replay::input("parameters", || self.slots.latch()) {
            return;
        }
        for cells in self.cells.lock().iter() {
            // They are freed when no process can latch any more: so not here.
            if let Some(cells) = cells.upgrade() {
                cells.note();
            }
        }
    }
}

/// Whether `process` is the one that runs here.
#[inline]
fn is_current(process: u32) -> bool {
    current::process(|current| current.is_some_and(|current| current.id().get() == process))
}

impl Cells {
    pub(super) fn new(reader: Arc<Reader>, name: Arc<str>, entry: usize, words: &[u64]) -> Self {
        let make = |_, index: usize| AtomicU64::new(words[index]);
        let memory = SlotMemory::new(words.len(), make);
        // Sets may have come before it was declared.
        memory.reach(reader.slots.front(), make);
        Self {
            reader,
            name,
            entry,
            words: memory,
        }
    }

    /// Fills the slot, for [`LatestSlots::publish`]. Allocates, if there was no such slot yet.
    pub(super) fn fill(&self, slot: usize, words: &[u64]) {
        self.words
            .reach(slot, |_, index| AtomicU64::new(words[index]));
        for (cell, &word) in self.words.slot(slot).iter().zip(words) {
            cell.store(word, Ordering::Release);
        }
    }

    /// Its only word. By [`LatestSlots::read`] too: a handle may be in another process, where the
    /// slot may be written again while it is read.
    #[inline(always)]
    pub(super) fn word(&self) -> u64 {
        let load = |slot: usize| self.words.slot(slot)[0].load(Ordering::Acquire);
        self.reader.slots.read(load)
    }

    /// Several words, all of one value.
    #[inline]
    pub(super) fn several<T>(&self, make: impl Fn(&[AtomicU64]) -> T) -> T {
        self.reader.slots.read(|slot| make(self.words.slot(slot)))
    }

    /// Records its value, or takes the recorded one.
    fn note(&self) {
        let slot = self.words.slot(self.reader.slots.front());
        let mut bytes = [0; replay::LONGEST];
        let bytes = &mut bytes[..8 * slot.len()];
        let fill = |bytes: &mut [u8]| {
            for (word, eight) in slot.iter().zip(bytes.chunks_exact_mut(8)) {
                eight.copy_from_slice(&word.load(Ordering::Relaxed).to_le_bytes());
            }
        };
        if replay::input_bytes(&self.name, bytes, fill) {
            let (eights, _) = bytes.as_chunks::<8>();
            for (word, eight) in slot.iter().zip(eights) {
                word.store(u64::from_le_bytes(*eight), Ordering::Release);
            }
        }
    }
}
