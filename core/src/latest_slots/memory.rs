//! Memory of slots, of which there can be more later.

use std::sync::OnceLock;

/// How many slots there are at first.
pub const SLOTS: usize = 4;

/// The values of slots, as many in each. They stay where they are when slots are added.
#[derive(Debug)]
pub struct SlotMemory<T> {
    each: usize,
    /// Those of the slots 0 to [`SLOTS`].
    values: Box<[T]>,
    more: More<T>,
}

/// The slots from [`SLOTS`] on: twice as many in each part as in all before, so that a slot is
/// found in O(log slots).
#[derive(Debug)]
struct More<T>(OnceLock<Box<Part<T>>>);

#[derive(Debug)]
struct Part<T> {
    first: usize,
    values: Box<[T]>,
    more: More<T>,
}

impl<T> SlotMemory<T> {
    /// [`SLOTS`] slots of `each` values, which `make` makes of the slot and the index in it.
    /// Allocates.
    pub fn new(each: usize, make: impl Fn(usize, usize) -> T) -> Self {
        Self {
            each,
            values: values(0..SLOTS, each, make),
            more: More(OnceLock::new()),
        }
    }

    /// The values of a slot.
    ///
    /// # Panics
    ///
    /// If it was not [reached](Self::reach).
    #[inline(always)]
    pub fn slot(&self, slot: usize) -> &[T] {
        if slot < SLOTS {
            return &self.values[slot * self.each..(slot + 1) * self.each];
        }
        self.later(slot)
    }

    /// How many slots there are.
    pub fn count(&self) -> usize {
        let (mut more, mut count) = (&self.more, SLOTS);
        while let Some(part) = more.0.get() {
            (more, count) = (&part.more, 2 * count);
        }
        count
    }

    /// Makes slots up to this one, if there are fewer. Allocates. By one thread at a time.
    pub fn reach(&self, slot: usize, make: impl Fn(usize, usize) -> T) {
        let (mut more, mut count) = (&self.more, SLOTS);
        while slot >= count {
            let part = more.0.get_or_init(|| {
                Box::new(Part {
                    first: count,
                    values: values(count..2 * count, self.each, &make),
                    more: More(OnceLock::new()),
                })
            });
            (more, count) = (&part.more, 2 * count);
        }
    }

    #[cold]
    fn later(&self, slot: usize) -> &[T] {
        let mut more = &self.more;
        while let Some(part) = more.0.get() {
            if slot < 2 * part.first {
                let at = slot - part.first;
                return &part.values[at * self.each..(at + 1) * self.each];
            }
            more = &part.more;
        }
        panic!("slot {slot} was not reached")
    }
}

fn values<T>(
    slots: std::ops::Range<usize>,
    each: usize,
    make: impl Fn(usize, usize) -> T,
) -> Box<[T]> {
    let make = &make;
    slots
        .flat_map(|slot| (0..each).map(move |index| make(slot, index)))
        .collect()
}
