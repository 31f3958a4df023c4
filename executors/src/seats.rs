//! Who was woken from elsewhere: a seat for each process of an executor, with one bit for each level at which it can be woken.
//!
//! A wake sets bits, each by one instruction that says the same however often it is carried out: the seat's, then that of the word it lies in, then
//! the level's among the executor's signals. So a wake takes a fixed number of steps, and none depends on another's: a waker that is preempted
//! half-way leaves nothing half done that a second one, of the same process or of another, would have to wait for. (A queue of links cannot
//! give that: to be in it once, a process is first marked and then queued, and who finds it marked relies on who marked it.)
//!
//! The price is the order of arrival: of those that were woken from elsewhere since the owner looked last, at one level, the one with the lower seat
//! comes first. All of them come before any that is woken later, so nobody starves.

use luna_platform::current::LEVELS;
use luna_platform::sync::Arc;
use luna_platform::sync::atomic::{AtomicU64, Ordering};

/// How many words a block has for each level; a model of all interleavings has to do with few.
const WORDS: usize = if cfg!(loom) { 1 } else { 64 };
const BITS: usize = u64::BITS as usize;
const SEATS: usize = WORDS * BITS;

/// The bits of 4096 seats: four bytes for each.
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
            summary: std::array::from_fn(zero),
            words: std::array::from_fn(|_| std::array::from_fn(zero)),
        }
    }
}

/// Where a process is woken from elsewhere. It may be used after the process has ended: then whoever has the seat next may be woken for nothing.
#[derive(Debug)]
pub(crate) struct Seat {
    block: Arc<Block>,
    number: usize,
}

impl Seat {
    /// Marks the process as woken at `level`. Wait-free: two instructions. The caller then signals the level.
    #[inline]
    pub(crate) fn mark(&self, level: u8) {
        let (word, bit) = (self.number % SEATS / BITS, self.number % BITS);
        let level = usize::from(level);
        // Release: who takes the bit sees all that happened before the wake. In this order, so that who finds a bit in the summary finds the word's.
        self.block.words[level][word].fetch_or(1 << bit, Ordering::AcqRel);
        self.block.summary[level].fetch_or(1 << word, Ordering::AcqRel);
    }

    /// As a waker that goes no further than so many steps.
    #[cfg(loom)]
    pub(crate) fn mark_partly(&self, level: u8, steps: usize) {
        let (word, bit) = (self.number % SEATS / BITS, self.number % BITS);
        let level = usize::from(level);
        if steps > 0 {
            self.block.words[level][word].fetch_or(1 << bit, Ordering::AcqRel);
        }
        if steps > 1 {
            self.block.summary[level].fetch_or(1 << word, Ordering::AcqRel);
        }
    }

    pub(crate) fn number(&self) -> usize {
        self.number
    }
}

/// The seats of one executor and who has them; the owner's alone.
#[derive(Debug)]
pub(crate) struct Seats<T> {
    blocks: Vec<Arc<Block>>,
    members: Vec<Option<T>>,
    free: Vec<usize>,
}

impl<T: Copy> Seats<T> {
    pub(crate) const fn new() -> Self {
        Self {
            blocks: Vec::new(),
            members: Vec::new(),
            free: Vec::new(),
        }
    }

    /// A seat for another one, who takes it by [`fill`](Self::fill). Allocates.
    pub(crate) fn reserve(&mut self) -> Seat {
        let number = self.free.pop().unwrap_or(self.members.len());
        if number == self.members.len() {
            self.members.push(None);
            // So that leaving allocates nothing.
            self.free.reserve(self.members.len() - self.free.len());
        }
        if self.blocks.len() <= number / SEATS {
            self.blocks.push(Arc::new(Block::new()));
        }
        Seat {
            block: self.blocks[number / SEATS].clone(),
            number,
        }
    }

    pub(crate) fn fill(&mut self, number: usize, member: T) {
        self.members[number] = Some(member);
    }

    /// Gives the seat of this number to the next who comes. O(1).
    pub(crate) fn leave(&mut self, number: usize) {
        self.members[number] = None;
        self.free.push(number);
    }

    /// Gives all who were marked at `level`, in the order of their seats. O(their number + seats / 4096).
    pub(crate) fn take(&self, level: u8, mut woken: impl FnMut(T)) {
        let level = usize::from(level);
        for (block, base) in self.blocks.iter().zip((0..).step_by(SEATS)) {
            // Asked first, since most of many blocks have nothing: who marks signals after it, so what is missed here is signalled again.
            if block.summary[level].load(Ordering::Relaxed) == 0 {
                continue;
            }
            for word in ones(block.summary[level].swap(0, Ordering::AcqRel)) {
                for bit in ones(block.words[level][word].swap(0, Ordering::AcqRel)) {
                    // Else a late wake of one who has left.
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
    std::iter::from_fn(move || {
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

    fn taken(seats: &Seats<usize>, level: u8) -> Vec<usize> {
        let mut taken = Vec::new();
        seats.take(level, |member| taken.push(member));
        taken
    }

    #[test]
    fn each_who_was_marked_is_given_once_wherever_it_sits() {
        let mut seats = Seats::new();
        let places: Vec<Seat> = (0..3 * SEATS + 1)
            .map(|member| {
                let seat = seats.reserve();
                seats.fill(seat.number(), member);
                seat
            })
            .collect();
        let marked = [0, 63, 64, SEATS - 1, SEATS, 3 * SEATS];
        for member in marked.into_iter().rev() {
            places[member].mark(7);
            places[member].mark(7);
        }
        places[1].mark(8);
        assert_eq!(taken(&seats, 7), marked);
        assert_eq!(taken(&seats, 7), []);
        assert_eq!(taken(&seats, 8), [1]);
    }

    #[test]
    fn a_late_wake_of_one_who_has_left_is_nobodys_or_the_next_ones() {
        let mut seats = Seats::new();
        let first = seats.reserve();
        seats.fill(first.number(), 1);
        seats.leave(first.number());
        first.mark(0);
        assert_eq!(taken(&seats, 0), []);
        let second = seats.reserve();
        assert_eq!(second.number(), first.number());
        seats.fill(second.number(), 2);
        first.mark(0);
        assert_eq!(taken(&seats, 0), [2]);
    }
}
