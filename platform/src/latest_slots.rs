//! Three slots for a value of which the latest matters: one writes, one reads, and neither ever waits for the other.
//!
//! The *owner* reads the front slot. The writer fills the back slot, which nobody reads, and swaps it with the one between; at a moment of its own the owner
//! swaps the front with the one between, if that is new. So what the owner reads changes only when it says so, all of it at once, and a value that came while another
//! was not taken yet takes its place. Nothing is allocated or freed, and each side does one atomic exchange.
//!
//! The values themselves lie with the user, three of each: this is who may touch which. They are atomics too, so that others than the owner may read the front
//! beside it, by [`read`](ThreeSlots::read): they look afterwards whether the slot still has the value that the owner took.

use crate::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// In `between`: the owner has not taken it yet.
const FRESH: usize = 4;
const SLOT: usize = 3;
/// In `front`: how far the number of the value stands left of its slot.
const NUMBER: u32 = 2;

/// Who may touch which of three slots. They all hold the value number 1 at first.
///
/// # Invariants
///
/// `front`, `back` and the slot of `between` are all different, and only their users exchange them.
#[derive(Debug)]
pub struct ThreeSlots {
    between: AtomicUsize,
    /// The owner's slot, and the number of the value that it has taken there: others know by that whether they read this one.
    front: AtomicU64,
    /// The writer's.
    back: AtomicUsize,
    /// The number of the value in each slot; 0 while it is written.
    numbers: [AtomicU64; 3],
}

impl Default for ThreeSlots {
    fn default() -> Self {
        Self::new()
    }
}

impl ThreeSlots {
    /// Three slots that hold the same.
    pub fn new() -> Self {
        Self {
            between: AtomicUsize::new(1),
            front: AtomicU64::new(1 << NUMBER),
            back: AtomicUsize::new(2),
            numbers: std::array::from_fn(|_| AtomicU64::new(1)),
        }
    }

    /// The slot that the owner reads. Wait-free.
    #[inline(always)]
    pub fn front(&self) -> usize {
        slot(self.front.load(Ordering::Relaxed))
    }

    /// Lets `write` fill a slot with the value of this number, with release stores, and offers it to the owner. Says whether the owner had taken the one before. Numbers are greater each time, from 2,
    /// below 2 to the 62. By one thread at a time. Wait-free.
    pub fn publish(&self, number: u64, write: impl FnOnce(usize)) -> bool {
        let back = self.back.load(Ordering::Relaxed);
        // Before the value, whose stores are releases: who sees any of it sees this.
        self.numbers[back].store(0, Ordering::Relaxed);
        write(back);
        self.numbers[back].store(number, Ordering::Release);
        let between = self.between.swap(back | FRESH, Ordering::AcqRel);
        self.back.store(between & SLOT, Ordering::Relaxed);
        between & FRESH == 0
    }

    /// Makes the latest value that was published the front one; says whether there was one. By the owner alone. Wait-free: a load, and an exchange if there is one.
    #[inline]
    pub fn latch(&self) -> bool {
        if !self.is_fresh() {
            return false;
        }
        let between = self.between.swap(self.front(), Ordering::AcqRel) & SLOT;
        let number = self.numbers[between].load(Ordering::Relaxed);
        self.front
            .store(number << NUMBER | between as u64, Ordering::Release);
        true
    }

    /// Whether a value was published that the owner has not taken.
    #[inline(always)]
    pub fn is_fresh(&self) -> bool {
        self.between.load(Ordering::Relaxed) & FRESH != 0
    }

    /// Lets `copy` read the front slot, with acquire loads, until what it has read is the value that the owner has taken. The owner's first look is always enough; another thread looks again only when
    /// the owner has taken a new value meanwhile, and never gets one that the owner has not taken, nor an older one than it got before.
    #[inline(always)]
    pub fn read<R>(&self, mut copy: impl FnMut(usize) -> R) -> R {
        loop {
            let front = self.front.load(Ordering::Acquire);
            let slot = slot(front);
            let read = copy(slot);
            // Once the owner has given the slot away, it may have a later value, or parts of one: who has seen any of it sees its number, or 0.
            if self.numbers[slot].load(Ordering::Relaxed) == front >> NUMBER {
                return read;
            }
            #[cfg(loom)]
            loom::thread::yield_now();
        }
    }

    /// The number of the value in the front slot.
    pub fn number(&self) -> u64 {
        self.front.load(Ordering::Acquire) >> NUMBER
    }
}

/// The slot that `front` names.
#[inline(always)]
fn slot(front: u64) -> usize {
    front as usize & SLOT
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn the_latest_is_taken_and_only_when_it_is_latched() {
        let slots = ThreeSlots::new();
        let values: [AtomicU64; 3] = std::array::from_fn(|_| AtomicU64::new(0));
        let put =
            |value: u64| slots.publish(value, |slot| values[slot].store(value, Ordering::Release));
        let get = || slots.read(|slot| values[slot].load(Ordering::Acquire));
        assert!(!slots.latch());
        for round in 1..20 {
            assert!(put(10 * round), "what was there is taken");
            assert!(!put(10 * round + 1));
            let before = if round == 1 { 0 } else { 10 * (round - 1) + 1 };
            assert_eq!(get(), before);
            assert!(slots.is_fresh() && slots.latch());
            assert_eq!((get(), slots.number()), (10 * round + 1, 10 * round + 1));
            assert!(!slots.latch());
        }
    }

    /// While somebody else copies the slot, the owner gives it away and it is written again: that value is not the owner's yet.
    #[test]
    fn another_reader_does_not_run_ahead_of_the_owner() {
        let slots = ThreeSlots::new();
        let values: [AtomicU64; 3] = std::array::from_fn(|_| AtomicU64::new(1));
        let put = |value: u64| {
            slots.publish(value, |slot| values[slot].store(value, Ordering::Release));
        };
        let mut looks = 0;
        let read = slots.read(|slot| {
            looks += 1;
            if looks == 1 {
                put(2);
                assert!(slots.latch());
                put(3);
                put(4);
                assert_eq!(values[slot].load(Ordering::Acquire), 4);
            }
            values[slot].load(Ordering::Acquire)
        });
        assert_eq!((read, looks, slots.number()), (2, 2, 2));
    }
}

#[cfg(all(test, loom))]
mod loom_tests;
