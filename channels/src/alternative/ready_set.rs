//! Which channels of an `Alternative` are ready, in its order of preference.
//!
//! Each member has a *position*; the ready member at the lowest position is next. A fair set moves
//! a member that was chosen behind all others, so positions grow; when they run out, all members
//! are numbered anew. That takes O(n) steps once in at least n choices; everything else takes as
//! many steps as there are levels of 64 positions: two for 4 096, three for 262 144.

use alloc::vec;
use alloc::vec::Vec;
use arrayvec::ArrayVec;

/// No position, no member.
const NONE: u32 = u32::MAX;

/// A set of positions with a fast minimum: a tree of words. Each bit of a word records whether the
/// word below it is empty.
#[derive(Debug)]
struct Positions {
    /// All levels, the lowest first; the last has one word.
    words: Vec<u64>,
    /// Where the levels above the lowest begin.
    above: ArrayVec<u32, 5>,
}

impl Positions {
    fn new(capacity: usize) -> Self {
        let mut above = ArrayVec::new();
        let mut words = capacity.div_ceil(64).max(1);
        let mut all = words;
        while words > 1 {
            above.push(all as u32);
            words = words.div_ceil(64);
            all += words;
        }
        Self {
            words: vec![0; all],
            above,
        }
    }

    #[inline]
    fn insert(&mut self, position: u32) {
        let mut index = position as usize;
        let mut start = 0;
        for &above in &self.above {
            let word = &mut self.words[start + index / 64];
            let was_empty = *word == 0;
            *word |= 1 << (index % 64);
            if !was_empty {
                // The levels above know.
                return;
            }
            index /= 64;
            start = above as usize;
        }
        self.words[start + index / 64] |= 1 << (index % 64);
    }

    #[inline]
    fn remove(&mut self, position: u32) {
        let mut index = position as usize;
        let mut start = 0;
        for &above in &self.above {
            let word = &mut self.words[start + index / 64];
            *word &= !(1 << (index % 64));
            if *word != 0 {
                return;
            }
            index /= 64;
            start = above as usize;
        }
        self.words[start + index / 64] &= !(1 << (index % 64));
    }

    #[inline]
    fn contains(&self, position: u32) -> bool {
        let index = position as usize;
        self.words[index / 64] & (1 << (index % 64)) != 0
    }

    #[inline]
    fn first(&self) -> Option<u32> {
        let mut index = 0;
        for &above in self.above.iter().rev() {
            let word = self.words[above as usize + index];
            if word == 0 {
                return None;
            }
            index = index * 64 + word.trailing_zeros() as usize;
        }
        let word = self.words[index];
        (word != 0).then(|| (index * 64) as u32 + word.trailing_zeros())
    }
}

/// See the module.
#[derive(Debug)]
pub(super) struct ReadySet {
    ready: Positions,
    /// Which member is at a position.
    at: Vec<u32>,
    /// Where a member is.
    position: Vec<u32>,
    /// The first position behind all members.
    next: u32,
    members: usize,
}

impl ReadySet {
    pub(super) fn new() -> Self {
        Self {
            ready: Positions::new(0),
            at: Vec::new(),
            position: Vec::new(),
            next: 0,
            members: 0,
        }
    }

    /// Adds a member behind all others, not ready. Allocates.
    pub(super) fn add(&mut self, member: usize) {
        if member >= self.position.len() {
            self.position.resize(member + 1, NONE);
        }
        self.members += 1;
        let wanted = (self.members * 4).next_power_of_two().max(64);
        if wanted > self.at.len() {
            let ready: Vec<u32> = self.ready_members().collect();
            self.at.resize(wanted, NONE);
            self.ready = Positions::new(wanted);
            for member in ready {
                self.set(member as usize);
            }
        }
        self.put_last(member);
    }

    /// Takes a member out. O(levels).
    pub(super) fn remove(&mut self, member: usize) {
        self.clear(member);
        self.at[self.position[member] as usize] = NONE;
        self.position[member] = NONE;
        self.members -= 1;
    }

    /// Marks a member as ready. O(levels).
    #[inline]
    pub(super) fn set(&mut self, member: usize) {
        self.ready.insert(self.position[member]);
    }

    /// Marks a member as not ready. O(levels).
    #[inline]
    pub(super) fn clear(&mut self, member: usize) {
        self.ready.remove(self.position[member]);
    }

    /// The ready member to choose. O(levels).
    #[inline]
    pub(super) fn first(&self) -> Option<usize> {
        Some(self.at[self.ready.first()? as usize] as usize)
    }

    /// Puts a member behind all others: it was chosen. O(levels), and O(members) once in that many
    /// calls.
    #[inline(always)]
    pub(super) fn put_behind(&mut self, member: usize) {
        let is_ready = self.ready.contains(self.position[member]);
        if is_ready {
            self.clear(member);
        }
        self.move_last(member);
        if is_ready {
            self.set(member);
        }
    }

    /// As [`put_behind`](Self::put_behind), for a member that is ready until now.
    #[inline(always)]
    pub(super) fn choose(&mut self, member: usize, stays_ready: bool) {
        self.clear(member);
        self.move_last(member);
        if stays_ready {
            self.set(member);
        }
    }

    #[inline]
    fn move_last(&mut self, member: usize) {
        self.at[self.position[member] as usize] = NONE;
        self.put_last(member);
    }

    #[inline]
    fn put_last(&mut self, member: usize) {
        if self.next as usize == self.at.len() {
            self.compact();
        }
        self.at[self.next as usize] = member as u32;
        self.position[member] = self.next;
        self.next += 1;
    }

    /// Moves all members to the front, in their order.
    #[cold]
    #[inline(never)]
    fn compact(&mut self) {
        let mut to = 0;
        for from in 0..self.at.len() {
            let member = self.at[from];
            if member == NONE {
                continue;
            }
            self.at[from] = NONE;
            let is_ready = self.ready.contains(from as u32);
            self.ready.remove(from as u32);
            self.at[to as usize] = member;
            self.position[member as usize] = to;
            if is_ready {
                self.ready.insert(to);
            }
            to += 1;
        }
        self.next = to;
    }

    fn ready_members(&self) -> impl Iterator<Item = u32> {
        self.at
            .iter()
            .enumerate()
            .filter(|&(position, &member)| member != NONE && self.ready.contains(position as u32))
            .map(|(_, &member)| member)
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
                    0 | 1 => {
                        set.set(member);
                        ready[member] = true;
                    }
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
        set.remove(0);
        assert_eq!(set.first(), Some(1));
        set.add(0);
        assert_eq!(set.first(), Some(1), "a new member is not ready");
        set.set(0);
        set.clear(1);
        set.clear(2);
        assert_eq!(set.first(), Some(0));
        for _ in 0..1000 {
            set.remove(0);
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
