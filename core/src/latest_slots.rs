//! A value of which the latest matters: one publisher, one owner, any number of other readers, all
//! wait-free.
//!
//! The *owner* reads the front slot. The publisher fills a free slot and offers it in `between`.
//! The owner takes the offer when it calls [`latch`](LatestSlots::latch). So the value that the
//! owner reads changes only at its own call, all words at once, and an offer that was not taken yet
//! is replaced by a later one. Other threads may [`read`](LatestSlots::read) the front slot too.
//!
//! # Why there are more than three slots
//!
//! With three slots, a slot that the owner gives away is written again at once, so a reader can
//! only copy and check. It must repeat the copy as long as the check fails. If the owner is
//! preempted in the middle of `latch`, the check fails until the owner runs again, and a reader of
//! higher priority on the same core never ends. A wait-free reader needs a slot that is not written
//! while it is read. Readers that are preempted while each reads another value then need a slot
//! each, so a fixed number of slots is not enough for any number of readers. This protocol counts
//! the readers of a slot in the word that names the slot, as the ARC register does (M. Ianni et
//! al., "Anonymous Readers Counting", 2017). It begins with [`SLOTS`] slots, which are enough as
//! long as no thread is preempted in the middle of a counted read. The publisher, which is not on
//! the real-time path, allocates more when readers hold all of them.
//!
//! # Bounds
//!
//! | operation | steps |
//! | --- | --- |
//! | [`front`](LatestSlots::front), [`is_fresh`](LatestSlots::is_fresh) | one load |
//! | [`latch`](LatestSlots::latch) | one load; with an offer 3 exchanges, 1 load, 1 store more |
//! | [`read`](LatestSlots::read) | 2 copies at most, 3 atomic operations; the owner: 1 copy |
//! | [`publish`](LatestSlots::publish) | one copy, one exchange, one load of each slot |
//!
//! There are at most twice as many slots as `SLOTS` and the greatest number of readers that held
//! slots at once.
//!
//! # Protocol
//!
//! A slot is in use, or retired with the number of readers that entered it. `latch` goes from the
//! slot `old` to the offered slot `new` in four steps: it takes the offer out of `between`,
//! exchanges `pins` (this names `new` to readers that count themselves, and says how many entered
//! `old`), raises `front` (this names `new` to readers that check), and retires `old`. A retired
//! slot is free once as many readers have left it as entered it.
//!
//! - A reader that finds the same `front` before and after its copy has read one value: the slot
//!   was not retired in between, so it was not written. An owner that stops anywhere in `latch`
//!   leaves `front` as it is, so it makes no check fail.
//! - A reader with a failed check enters through `pins`. Its slot stays until it leaves.
//! - That reader may have learned of `new` before the owner has raised `front`. It raises `front`
//!   itself before it returns, so that no later read finds an older value.
//! - At most four slots are not free without counted readers: the front, the one in the owner's
//!   hand, the offer, and the one that is written.
//!
//! The values themselves belong to the user, in a [`SlotMemory`] each; this type decides which slot
//! may be accessed when. The values are atomics, since a reader may have read a slot while it was
//! written, before its check fails.

mod memory;

pub use memory::{SLOTS, SlotMemory};

use luna_platform::guard::OnDrop;
use luna_platform::sync::atomic::{AtomicU32, AtomicU64, AtomicUsize, Ordering};

/// In `between`: nothing is offered. Else it is the slot and 1.
const NOTHING: usize = 0;
/// In `front`: where the number of the value begins. Below it is the slot.
const NUMBER: u32 = 16;
/// In `pins`: where the slot begins. Below it is how many readers have entered.
const PINNED: u32 = 32;
/// In `entered`: the slot is retired. Below it is how many readers have entered.
const RETIRED: u64 = 1 << 32;

/// Which of several slots may be accessed when. They all hold the value number 1 at first.
///
/// # Invariants
///
/// `pins` and `front` name slots that are in use. A slot is retired by the owner, or by the
/// publisher if the owner never took it. The publisher alone makes a retired slot one in use, once
/// all readers that entered have left. The numbers in `front` only rise.
#[derive(Debug)]
pub struct LatestSlots {
    between: AtomicUsize,
    /// The owner's slot and the number of its value.
    front: AtomicU64,
    /// The owner's slot, and how many readers have entered it. Never behind `front`.
    pins: AtomicU64,
    slots: SlotMemory<Slot>,
}

#[derive(Debug)]
struct Slot {
    number: AtomicU64,
    /// [`RETIRED`] with a count, or 0 while it is in use.
    entered: AtomicU64,
    /// How many of those that entered have left.
    left: AtomicU32,
}

impl Slot {
    fn new(entered: u64) -> Self {
        Self {
            number: AtomicU64::new(1),
            entered: AtomicU64::new(entered),
            left: AtomicU32::new(0),
        }
    }

    fn is_free(&self) -> bool {
        // Acquire: what the owner and the readers did with the slot is over when it is written.
        let entered = self.entered.load(Ordering::Acquire);
        entered & RETIRED != 0 && entered & !RETIRED == u64::from(self.left.load(Ordering::Acquire))
    }
}

impl LatestSlots {
    /// Slots that all hold the same. Allocates.
    pub fn new() -> Self {
        Self {
            between: AtomicUsize::new(NOTHING),
            front: AtomicU64::new(1 << NUMBER),
            pins: AtomicU64::new(0),
            slots: SlotMemory::new(1, |slot, _| Slot::new(if slot == 0 { 0 } else { RETIRED })),
        }
    }

    /// The slot that the owner reads. Wait-free.
    #[inline(always)]
    pub fn front(&self) -> usize {
        slot(self.front.load(Ordering::Relaxed))
    }

    /// Lets `write` fill a slot with the value of this number, with release stores, and offers it
    /// to the owner. Returns whether the owner had taken the one before. The slot may be new:
    /// `write` makes room for it ([`SlotMemory::reach`]). Numbers are greater
    /// each time, from 2, below 2 to the 48. By one thread at a time. Wait-free; allocates when
    /// readers hold all slots.
    ///
    /// # Panics
    ///
    /// If more than 65 000 threads stopped in the middle of a read, each in another value.
    pub fn publish(&self, number: u64, write: impl FnOnce(usize)) -> bool {
        let free = self.free();
        write(free);
        let own = self.slot(free);
        own.number.store(number, Ordering::Relaxed);
        let before = self.between.swap(free + 1, Ordering::AcqRel);
        if before != NOTHING {
            // The owner never took it, so no reader has entered it.
            let untaken = self.slot(before - 1);
            untaken.entered.store(RETIRED, Ordering::Relaxed);
        }
        before == NOTHING
    }

    /// Makes a free slot one in use.
    fn free(&self) -> usize {
        let found = (0..self.slots.count()).find(|&slot| self.slot(slot).is_free());
        let free = found.unwrap_or_else(|| {
            let new = self.slots.count();
            assert!(
                new < 1 << NUMBER,
                "readers hold all slots that there can be"
            );
            self.slots.reach(new, |_, _| Slot::new(RETIRED));
            new
        });
        let slot = self.slot(free);
        slot.left.store(0, Ordering::Relaxed);
        slot.entered.store(0, Ordering::Relaxed);
        free
    }

    /// Makes the latest value that was published the front one; returns whether there was one.
    /// By the owner alone. Wait-free.
    #[inline]
    pub fn latch(&self) -> bool {
        if !self.is_fresh() {
            return false;
        }
        let new = self.take();
        let old = self.pin(new);
        self.show(new);
        self.retire(old);
        true
    }

    /// Takes the offer. There is one: only the owner takes it out.
    #[inline]
    fn take(&self) -> usize {
        self.between.swap(NOTHING, Ordering::AcqRel) - 1
    }

    /// Names the slot to readers that enter; returns what was there.
    #[inline]
    fn pin(&self, new: usize) -> u64 {
        self.pins.swap((new as u64) << PINNED, Ordering::AcqRel)
    }

    /// Names the slot, which is in use, to the owner and to readers that check; unless a later one
    /// was named.
    #[inline]
    fn show(&self, new: usize) {
        let number = self.slot(new).number.load(Ordering::Relaxed);
        self.front
            .fetch_max(number << NUMBER | new as u64, Ordering::AcqRel);
    }

    /// Gives the slot before to the publisher, with the number of its readers.
    #[inline]
    fn retire(&self, old: u64) {
        let entered = RETIRED | old & (RETIRED - 1);
        let old = self.slot((old >> PINNED) as usize);
        // Release: the owner has read it, and has raised `front`, before the slot is written again.
        old.entered.store(entered, Ordering::Release);
    }

    /// Whether a value was published that the owner has not taken.
    #[inline(always)]
    pub fn is_fresh(&self) -> bool {
        self.between.load(Ordering::Relaxed) != NOTHING
    }

    /// Lets `copy` read the front slot, with acquire loads, and returns what it has made of the
    /// value that the owner has taken. Calls it once for the owner, and at most twice for others,
    /// which never get a value that the owner has not begun to take, nor an older one than any
    /// reader got before. Wait-free. `copy` may see parts of two values; what it returns then is
    /// dropped.
    #[inline(always)]
    pub fn read<R>(&self, mut copy: impl FnMut(usize) -> R) -> R {
        let front = self.front.load(Ordering::Acquire);
        let read = copy(slot(front));
        // A reader that has seen any part of a later value in this slot sees a later `front`: the
        // owner raised that before it retired the slot, and the publisher saw the slot retired
        // before it wrote there.
        if self.front.load(Ordering::Relaxed) == front {
            return read;
        }
        self.read_pinned(copy)
    }

    /// As [`read`](Self::read), of a slot that stays until it is read.
    #[cold]
    fn read_pinned<R>(&self, mut copy: impl FnMut(usize) -> R) -> R {
        // A thread enters a slot twice at most, since it enters only after `front` was changed: 32
        // bits are enough.
        let entered = self.pins.fetch_add(1, Ordering::AcqRel);
        let slot = (entered >> PINNED) as usize;
        // Release: the slot is read before it is written again. Also if `copy` panics.
        let leave = OnDrop::new(|| {
            self.slot(slot).left.fetch_add(1, Ordering::Release);
        });
        let read = copy(slot);
        // No later read, of any thread, is to find the value before.
        self.show(slot);
        drop(leave);
        read
    }

    /// The number of the value in the front slot.
    pub fn number(&self) -> u64 {
        self.front.load(Ordering::Acquire) >> NUMBER
    }

    #[inline(always)]
    fn slot(&self, slot: usize) -> &Slot {
        &self.slots.slot(slot)[0]
    }
}

/// The slot that `front` names.
#[inline(always)]
fn slot(front: u64) -> usize {
    front as usize & ((1 << NUMBER) - 1)
}

#[cfg(all(test, not(loom)))]
mod tests;

#[cfg(all(test, loom))]
mod loom_tests;
