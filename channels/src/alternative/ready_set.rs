//! Which channels of an `Alternative` are ready, in its order of preference.
//!
//! Each member has a *rank*; the ready member of the lowest rank is first. A fair set gives a
//! member that was chosen a rank behind all others. The heap of the ready members still has the
//! old rank. It is corrected when the member is first in the heap, so no call searches for a member
//! that was chosen.

use alloc::collections::BinaryHeap;
use alloc::vec::Vec;
use core::cmp::Reverse;

/// See the module.
#[derive(Debug)]
pub(super) struct ReadySet {
    /// A ready member that is not in the heap, if there is one: the only one, unless others have
    /// become ready since the last [`first`](Self::first). Most sets have one ready member, of
    /// which the rank does not matter.
    lone: Option<usize>,
    /// The other ready members, each once, with a rank that it has or has had.
    ready: BinaryHeap<Reverse<(u64, usize)>>,
    ranks: Vec<u64>,
    /// The first rank behind all members.
    next: u64,
}

impl ReadySet {
    pub(super) fn new() -> Self {
        Self {
            lone: None,
            ready: BinaryHeap::new(),
            ranks: Vec::new(),
            next: 0,
        }
    }

    /// Adds a member behind all others, not ready. Allocates: no other method does.
    pub(super) fn add(&mut self, member: usize) {
        if member >= self.ranks.len() {
            self.ranks.resize(member + 1, 0);
            self.ready.reserve(self.ranks.len() - self.ready.len());
        }
        self.put_behind(member);
    }

    /// Marks a member as ready that was not. O(log n).
    #[inline]
    pub(super) fn set(&mut self, member: usize) {
        match self.lone.is_none() && self.ready.is_empty() {
            true => self.lone = Some(member),
            false => self.push(member),
        }
    }

    #[inline(never)]
    fn push(&mut self, member: usize) {
        debug_assert!(
            self.ready.len() < self.ready.capacity(),
            "it would allocate"
        );
        self.ready.push(Reverse((self.ranks[member], member)));
    }

    /// Marks a member as not ready. O(log n) for the first one, O(n) for another.
    pub(super) fn clear(&mut self, member: usize) {
        match self.first() == Some(member) {
            true => self.clear_first(),
            false => self.ready.retain(|&Reverse((_, other))| other != member),
        }
    }

    /// Marks the [first](Self::first) as not ready, which was just asked for. O(log n).
    #[inline]
    pub(super) fn clear_first(&mut self) {
        if self.lone.take().is_some() {
            debug_assert!(self.ready.is_empty(), "`first` was not asked for");
        } else {
            self.ready.pop();
        }
    }

    /// Marks all as not ready.
    pub(super) fn clear_all(&mut self) {
        self.lone = None;
        self.ready.clear();
    }

    /// The ready member to choose. O(log n), and as much for each one that was put behind while it
    /// was ready.
    #[inline]
    pub(super) fn first(&mut self) -> Option<usize> {
        match self.ready.is_empty() {
            true => self.lone,
            false => self.first_of_many(),
        }
    }

    #[inline(never)]
    fn first_of_many(&mut self) -> Option<usize> {
        if let Some(lone) = self.lone.take() {
            self.push(lone);
        }
        while let Some(&Reverse((rank, member))) = self.ready.peek() {
            if self.ranks[member] == rank {
                return Some(member);
            }
            if let Some(mut first) = self.ready.peek_mut() {
                first.0.0 = self.ranks[member];
            }
        }
        None
    }

    /// Puts a member behind all others: it was chosen.
    #[inline]
    pub(super) fn put_behind(&mut self, member: usize) {
        self.ranks[member] = self.next;
        self.next += 1;
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn the_least_recently_chosen_ready_member_is_first() {
        for members in [1, 3, 64, 65, 5000] {
            let mut set = ReadySet::new();
            // What it must do, done slowly.
            let mut order: Vec<usize> = (0..members).collect();
            let mut ready = vec![false; members];
            for member in 0..members {
                set.add(member);
            }
            let mut random = 88_172_645_463_325_252_u64;
            for _ in 0..4 * members.min(500) + 300 {
                random ^= random << 13;
                random ^= random >> 7;
                random ^= random << 17;
                let member = (random >> 8) as usize % members;
                match random % 4 {
                    0 | 1 if !ready[member] => {
                        set.set(member);
                        ready[member] = true;
                    }
                    0 | 1 => {}
                    2 => {
                        set.clear(member);
                        ready[member] = false;
                    }
                    _ => {
                        set.put_behind(member);
                        order.retain(|&other| other != member);
                        order.push(member);
                    }
                }
                let first = order.iter().copied().find(|&member| ready[member]);
                assert_eq!(set.first(), first);
            }
        }
    }

    #[test]
    fn members_come_and_go() {
        let mut set = ReadySet::new();
        (0..3).for_each(|member| set.add(member));
        (0..3).for_each(|member| set.set(member));
        set.clear(0);
        assert_eq!(set.first(), Some(1));
        set.add(0);
        assert_eq!(set.first(), Some(1), "a new member is not ready");
        set.set(0);
        set.clear(1);
        set.clear(2);
        assert_eq!(set.first(), Some(0));
        for _ in 0..1000 {
            set.clear(0);
            set.add(0);
        }
        assert_eq!(set.first(), None);
        for member in 3..200 {
            set.add(member);
            set.set(member);
        }
        assert_eq!(set.first(), Some(3));
    }
}
