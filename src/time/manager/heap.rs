//! Deadlines in order, in reserved room: a binary heap that keeps the position of each of its
//! members.

/// As many members as there is room for, by their numbers, each with one deadline at most.
#[derive(Debug, Default)]
pub(super) struct Heap {
    /// Each member's deadline is not before that of the one at half its index.
    order: Vec<(u64, u32)>,
    /// Where each member stands in `order`.
    places: Vec<u32>,
}

const NOWHERE: u32 = u32::MAX;

impl Heap {
    /// Makes room for members 0 to `members - 1`. Allocates.
    pub(super) fn reserve(&mut self, members: usize) {
        if members > self.places.len() {
            self.places.resize(members, NOWHERE);
            self.order.reserve(members - self.order.len());
        }
    }

    /// The first deadline, and its member; of equal ones the member with the lowest number. O(1).
    pub(super) fn first(&self) -> Option<(u64, usize)> {
        self.order
            .first()
            .map(|&(deadline, member)| (deadline, member as usize))
    }

    /// Enters a member that is not there, for which there is room. O(log n), no allocation.
    pub(super) fn insert(&mut self, member: usize, deadline: u64) {
        debug_assert_eq!(self.places[member], NOWHERE);
        self.order.push((deadline, member as u32));
        self.rise(self.order.len() - 1);
    }

    /// Takes a member out, if it is there. O(log n).
    pub(super) fn remove(&mut self, member: usize) -> bool {
        let place = std::mem::replace(&mut self.places[member], NOWHERE);
        if place == NOWHERE {
            return false;
        }
        self.order.swap_remove(place as usize);
        if (place as usize) < self.order.len() {
            // The member that stands there now came from the end, of whichever branch.
            let place = self.rise(place as usize);
            self.sink(place);
        }
        true
    }

    /// Moves the one at `place` up as far as it has to, and gives where it stands.
    fn rise(&mut self, mut place: usize) -> usize {
        let moved = self.order[place];
        while place > 0 {
            let parent = (place - 1) / 2;
            if self.order[parent] <= moved {
                break;
            }
            self.put(place, self.order[parent]);
            place = parent;
        }
        self.put(place, moved);
        place
    }

    fn sink(&mut self, mut place: usize) {
        let moved = self.order[place];
        loop {
            let left = 2 * place + 1;
            let children = left..(left + 2).min(self.order.len());
            let Some(child) = children.min_by_key(|&child| self.order[child]) else {
                break;
            };
            if moved <= self.order[child] {
                break;
            }
            self.put(place, self.order[child]);
            place = child;
        }
        self.put(place, moved);
    }

    fn put(&mut self, place: usize, one: (u64, u32)) {
        self.order[place] = one;
        self.places[one.1 as usize] = place as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn it_is_in_order_whatever_is_entered_and_taken_out() {
        let mut heap = Heap::default();
        heap.reserve(50);
        let mut expected = BTreeSet::new();
        let mut deadlines = [None; 50];
        let mut state = 7_u64;
        for _ in 0..20_000 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            let (member, deadline) = ((state >> 33) as usize % 50, state >> 58);
            match deadlines[member].take() {
                Some(before) => {
                    assert!(heap.remove(member));
                    expected.remove(&(before, member));
                }
                None => {
                    assert!(!heap.remove(member));
                    heap.insert(member, deadline);
                    expected.insert((deadline, member));
                    deadlines[member] = Some(deadline);
                }
            }
            assert_eq!(heap.first(), expected.first().copied());
        }
        while let Some((deadline, member)) = heap.first() {
            assert_eq!(expected.pop_first(), Some((deadline, member)));
            assert!(heap.remove(member));
        }
        assert!(expected.is_empty());
    }
}
