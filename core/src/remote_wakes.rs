//! Wakes from other threads: a wake slot for each process of an executor, with one bit for each
//! level at which it can be woken.
//!
//! A wake sets bits, each by one idempotent instruction: the slot's bit, then that of the word it
//! lies in, then the level's among the executor's signals. The first slots have a word each that
//! lies beside the signals, so that a wake from another core fetches one line of memory instead of
//! three. So a wake takes a fixed number of steps, and none depends on another's: a waker that is
//! preempted half-way leaves nothing half done that a second one, of the same process or of
//! another, would have to wait for. (A linked queue cannot give that: to be in it once, a process
//! is first marked and then queued, and a second waker that finds it marked relies on the first one
//! to queue it.)
//!
//! The price is the order of arrival: of the processes that were woken by other threads since the
//! owner looked last, at one level, the one with the lower slot comes first. All of them come
//! before any that is woken later, so no process starves.

use crate::current::LEVELS;
use alloc::vec::Vec;
use luna_platform::sync::Arc;
use luna_platform::sync::atomic::{AtomicU32, AtomicU64, Ordering};

/// Number of wake slots with a word beside the signals: what is left of their line. A model must
/// have slots of both kinds.
pub(crate) const FIRST: usize = if cfg!(loom) { 1 } else { 10 };

/// The words of the first wake slots: the levels at which each was woken. They lie where the
/// owner's signals do.
#[derive(Debug)]
pub(crate) struct FirstSlots([AtomicU32; FIRST]);

impl FirstSlots {
    pub(crate) fn new() -> Self {
        Self(core::array::from_fn(|_| AtomicU32::new(0)))
    }
}

/// Number of words that a block has for each level; few in a model of all interleavings, and where
/// there is little memory.
const WORDS: usize = if cfg!(any(loom, not(feature = "std"))) {
    1
} else {
    64
};
const BITS: usize = u64::BITS as usize;
const BLOCK_SLOTS: usize = WORDS * BITS;

/// The bits of 4096 wake slots: four bytes for each. Without an operating system, of 64 slots.
#[derive(Debug)]
struct Block {
    /// For each level, which of its words may have a bit set.
    summary: [AtomicU64; LEVELS as usize],
    words: [[AtomicU64; WORDS]; LEVELS as usize],
}

impl Block {
    fn new() -> Self {
        let zero = |_| AtomicU64::new(0);
        Self {
            summary: core::array::from_fn(zero),
            words: core::array::from_fn(|_| core::array::from_fn(zero)),
        }
    }
}

/// The slot in which a process is woken from other threads. It may be used after the process has
/// ended: then the process that has the slot next may get a spurious wake.
#[derive(Debug)]
pub(crate) struct WakeSlot {
    number: usize,
    /// Where the bits of a wake slot behind the first ones are.
    block: Option<Arc<Block>>,
}

impl WakeSlot {
    /// Marks the process as woken at `level`. Wait-free: one instruction or two, in this order, so
    /// that a reader that finds a bit in the summary finds the word's. The caller, which has
    /// `first` of the same owner, then signals the level.
    #[inline]
    pub(crate) fn mark(&self, first: &FirstSlots, level: u8) {
        self.mark_word(first, level);
        self.mark_summary(level);
    }

    #[inline(always)]
    pub(crate) fn mark_word(&self, first: &FirstSlots, level: u8) {
        // Release: the thread that takes the bit sees all that happened before the wake.
        match &self.block {
            None => first.0[self.number]
                .fetch_or(1 << level, Ordering::AcqRel)
                .into(),
            Some(block) => {
                let (word, bit) = self.place();
                block.words[usize::from(level)][word].fetch_or(1 << bit, Ordering::AcqRel)
            }
        };
    }

    #[inline(always)]
    pub(crate) fn mark_summary(&self, level: u8) {
        if let Some(block) = &self.block {
            let (word, _) = self.place();
            block.summary[usize::from(level)].fetch_or(1 << word, Ordering::AcqRel);
        }
    }

    /// Its word and its bit in its block.
    #[inline(always)]
    fn place(&self) -> (usize, usize) {
        let number = self.number - FIRST;
        (number % BLOCK_SLOTS / BITS, number % BITS)
    }

    pub(crate) fn number(&self) -> usize {
        self.number
    }
}

/// The wake slots of one executor and the processes that have them; the owner's alone.
#[derive(Debug)]
pub(crate) struct RemoteWakes<T> {
    blocks: Vec<Arc<Block>>,
    members: Vec<Option<T>>,
    free: Vec<u32>,
}

impl<T: Copy> RemoteWakes<T> {
    pub(crate) const fn new() -> Self {
        Self {
            blocks: Vec::new(),
            members: Vec::new(),
            free: Vec::new(),
        }
    }

    /// Gives one more process a slot. Allocates.
    pub(crate) fn enter(&mut self, member: T) -> WakeSlot {
        let free = self.free.pop();
        let number = free.map_or(self.members.len(), |number| number as usize);
        if number == self.members.len() {
            self.members.push(None);
            // So that `leave` allocates nothing.
            self.free.reserve(self.members.len() - self.free.len());
        }
        self.members[number] = Some(member);
        let block = number.checked_sub(FIRST).map(|number| {
            if self.blocks.len() <= number / BLOCK_SLOTS {
                self.blocks.push(Arc::new(Block::new()));
            }
            self.blocks[number / BLOCK_SLOTS].clone()
        });
        WakeSlot { number, block }
    }

    /// How many processes have a slot.
    pub(crate) fn count(&self) -> usize {
        self.members.len() - self.free.len()
    }

    /// All processes that have a slot, in the order of the slots.
    pub(crate) fn members(&self) -> impl Iterator<Item = T> {
        self.members.iter().copied().flatten()
    }

    /// The first process that has the slot `number` or a later one; `number` is then the one
    /// behind.
    pub(crate) fn next(&self, number: &mut usize) -> Option<T> {
        let later = self.members.get(*number..)?;
        let (skipped, member) = later
            .iter()
            .enumerate()
            .find_map(|(skipped, member)| Some((skipped, (*member)?)))?;
        *number += skipped + 1;
        Some(member)
    }

    /// Frees the slot of this number for the next process. O(1).
    pub(crate) fn leave(&mut self, number: usize) {
        self.members[number] = None;
        // Processes are numbered by 32 bits, so there are never more at once.
        self.free.push(number as u32);
    }

    /// Passes all processes that were marked at `level` to `woken`, in the order of their slots.
    /// `first` is this owner's. O(their number + slots / 4096).
    pub(crate) fn take(&self, first: &FirstSlots, level: u8, mut woken: impl FnMut(T)) {
        for (word, member) in first.0.iter().zip(&self.members) {
            // Read first. A waker signals after it marks. A mark not seen here has its signal after
            // the clearing of the level's bit (`Inbound::take`), so the next round looks again.
            if word.load(Ordering::Relaxed) & (1 << level) == 0 {
                continue;
            }
            word.fetch_and(!(1 << level), Ordering::AcqRel);
            // Otherwise a late wake of a process that has left.
            if let Some(member) = *member {
                woken(member);
            }
        }
        let level = usize::from(level);
        for (block, base) in self.blocks.iter().zip((FIRST..).step_by(BLOCK_SLOTS)) {
            // As above: most of many blocks have nothing.
            if block.summary[level].load(Ordering::Relaxed) == 0 {
                continue;
            }
            for word in ones(block.summary[level].swap(0, Ordering::AcqRel)) {
                for bit in ones(block.words[level][word].swap(0, Ordering::AcqRel)) {
                    if let Some(member) = self.members[base + word * BITS + bit] {
                        woken(member);
                    }
                }
            }
        }
    }
}

/// The places of the bits that are set, lowest first.
fn ones(mut bits: u64) -> impl Iterator<Item = usize> {
    core::iter::from_fn(move || {
        let place = bits.trailing_zeros() as usize;
        (bits != 0).then(|| {
            bits &= bits - 1;
            place
        })
    })
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    fn taken(remote_wakes: &RemoteWakes<usize>, first: &FirstSlots, level: u8) -> Vec<usize> {
        let mut taken = Vec::new();
        remote_wakes.take(first, level, |member| taken.push(member));
        taken
    }

    #[test]
    fn each_that_was_marked_is_given_once_wherever_it_sits() {
        let (mut remote_wakes, first) = (RemoteWakes::new(), FirstSlots::new());
        let places: Vec<WakeSlot> = (0..FIRST + 3 * BLOCK_SLOTS + 1)
            .map(|member| remote_wakes.enter(member))
            .collect();
        let far =
            [0, 63, 64, BLOCK_SLOTS - 1, BLOCK_SLOTS, 3 * BLOCK_SLOTS].map(|number| FIRST + number);
        let marked = [&[0, FIRST - 1][..], &far].concat();
        for &member in marked.iter().rev() {
            places[member].mark(&first, 7);
            places[member].mark(&first, 7);
        }
        places[1].mark(&first, 8);
        places[FIRST].mark(&first, 8);
        assert_eq!(taken(&remote_wakes, &first, 7), marked);
        assert_eq!(taken(&remote_wakes, &first, 7), []);
        assert_eq!(taken(&remote_wakes, &first, 8), [1, FIRST]);
    }

    #[test]
    fn a_late_wake_of_one_that_has_left_is_nobodys_or_the_next_ones() {
        let (mut remote_wakes, first) = (RemoteWakes::new(), FirstSlots::new());
        for number in 0..FIRST + 2 {
            let one = remote_wakes.enter(1);
            assert_eq!(one.number(), number);
            remote_wakes.leave(number);
            one.mark(&first, 0);
            assert_eq!(taken(&remote_wakes, &first, 0), []);
            let second = remote_wakes.enter(2);
            assert_eq!(second.number(), number);
            one.mark(&first, 0);
            assert_eq!(taken(&remote_wakes, &first, 0), [2]);
        }
    }
}
