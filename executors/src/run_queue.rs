//! The processes of one executor that are ready: a queue for each level, touched by the executor's thread alone.

use crate::link::Link;
use luna_platform::current::{self, LEVELS};
use std::cell::Cell;
use std::ptr::NonNull;

/// First come first served within a level; one bit for each level that is not empty, kept where channels can see it
/// ([`current::ready_levels`]). Every operation is O(1) and free of atomics.
///
/// # Invariants
///
/// A level's `first` and `last` are the ends of a doubly linked chain of live links that are in no other queue, and its bit says whether
/// there is one.
#[derive(Debug)]
pub(crate) struct RunQueue {
    levels: [Level; LEVELS as usize],
}

#[derive(Debug)]
struct Level {
    first: Cell<Option<NonNull<Link>>>,
    last: Cell<Option<NonNull<Link>>>,
}

impl RunQueue {
    pub(crate) const fn new() -> Self {
        Self {
            levels: [const {
                Level {
                    first: Cell::new(None),
                    last: Cell::new(None),
                }
            }; LEVELS as usize],
        }
    }

    /// The highest level with a ready process.
    #[inline]
    pub(crate) fn highest_level(&self) -> Option<u8> {
        let bits = current::ready_levels();
        (bits != 0).then(|| (31 - bits.leading_zeros()) as u8)
    }

    /// Puts a process behind the others of its level.
    ///
    /// # Safety
    ///
    /// `node` is live until it is popped and is in no queue. `level` is below [`LEVELS`].
    #[inline]
    pub(crate) unsafe fn push_back(&self, level: u8, node: NonNull<Link>) {
        let queue = &self.levels[usize::from(level)];
        // SAFETY: the new node is live by the contract, the last one by the invariant.
        unsafe {
            node.as_ref().set_next(None);
            let last = queue.last.replace(Some(node));
            node.as_ref().set_previous(last);
            match last {
                Some(last) => last.as_ref().set_next(Some(node)),
                None => {
                    queue.first.set(Some(node));
                    current::set_ready_levels(current::ready_levels() | 1 << level);
                }
            }
        }
    }

    /// Puts a process before the others of its level.
    ///
    /// # Safety
    ///
    /// As for [`push_back`](Self::push_back).
    #[inline]
    pub(crate) unsafe fn push_front(&self, level: u8, node: NonNull<Link>) {
        let queue = &self.levels[usize::from(level)];
        // SAFETY: the new node is live by the contract, the first one by the invariant.
        unsafe {
            let first = queue.first.replace(Some(node));
            node.as_ref().set_next(first);
            node.as_ref().set_previous(None);
            match first {
                Some(first) => first.as_ref().set_previous(Some(node)),
                None => {
                    queue.last.set(Some(node));
                    current::set_ready_levels(current::ready_levels() | 1 << level);
                }
            }
        }
    }

    /// Takes a process out, wherever it stands in its level.
    ///
    /// # Safety
    ///
    /// `node` is in this queue, at `level`.
    pub(crate) unsafe fn remove(&self, level: u8, node: NonNull<Link>) {
        let queue = &self.levels[usize::from(level)];
        // SAFETY: by the contract the node is queued, so by the invariant it and its neighbours are live.
        unsafe {
            let (previous, next) = (node.as_ref().previous(), node.as_ref().next());
            match previous {
                Some(previous) => previous.as_ref().set_next(next),
                None => queue.first.set(next),
            }
            match next {
                Some(next) => next.as_ref().set_previous(previous),
                None => queue.last.set(previous),
            }
        }
        if queue.first.get().is_none() {
            current::set_ready_levels(current::ready_levels() & !(1 << level));
        }
    }

    /// Takes the first process of the highest level.
    #[inline]
    pub(crate) fn pop(&self) -> Option<NonNull<Link>> {
        let level = self.highest_level()?;
        let queue = &self.levels[usize::from(level)];
        let node = queue.first.get()?;
        // SAFETY: a queued node is live.
        let next = unsafe { node.as_ref() }.next();
        queue.first.set(next);
        match next {
            // SAFETY: as above.
            Some(next) => unsafe { next.as_ref() }.set_previous(None),
            None => {
                queue.last.set(None);
                current::set_ready_levels(current::ready_levels() & !(1 << level));
            }
        }
        Some(node)
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn highest_level_first_then_by_arrival() {
        let links: Vec<Link> = (0..6).map(|_| Link::new()).collect();
        let queue = RunQueue::new();
        for (index, level) in [0, 31, 5, 5, 31, 0].into_iter().enumerate() {
            // SAFETY: the links outlive the queue and are pushed once.
            unsafe { queue.push_back(level, NonNull::from(&links[index])) };
        }
        assert_eq!(queue.highest_level(), Some(31));
        let order: Vec<usize> = std::iter::from_fn(|| queue.pop())
            .map(|node| {
                links
                    .iter()
                    .position(|link| NonNull::from(link) == node)
                    .unwrap()
            })
            .collect();
        assert_eq!(order, [1, 4, 2, 3, 0, 5]);
        assert_eq!(current::ready_levels(), 0);
    }

    #[test]
    fn who_resumes_comes_before_its_level_and_after_higher_ones() {
        let links: Vec<Link> = (0..3).map(|_| Link::new()).collect();
        let queue = RunQueue::new();
        // SAFETY: the links outlive the queue and are pushed once.
        unsafe {
            queue.push_back(3, NonNull::from(&links[0]));
            queue.push_front(3, NonNull::from(&links[1]));
            queue.push_back(4, NonNull::from(&links[2]));
        }
        let order: Vec<NonNull<Link>> = std::iter::from_fn(|| queue.pop()).collect();
        assert_eq!(order, [2, 1, 0].map(|index| NonNull::from(&links[index])));
    }

    #[test]
    fn who_is_taken_out_leaves_the_others_in_order() {
        for gone in 0..4 {
            let links: Vec<Link> = (0..4).map(|_| Link::new()).collect();
            let queue = RunQueue::new();
            // SAFETY: the links outlive the queue and are pushed once; the one that is taken out is queued.
            unsafe {
                // 2 0 1 3, and one that is alone at its level.
                queue.push_back(3, NonNull::from(&links[0]));
                queue.push_back(3, NonNull::from(&links[1]));
                queue.push_front(3, NonNull::from(&links[2]));
                queue.push_back(5, NonNull::from(&links[3]));
                let level = if gone == 3 { 5 } else { 3 };
                queue.remove(level, NonNull::from(&links[gone]));
                assert_eq!(current::ready_levels() & 1 << 5 != 0, gone != 3);
                // And comes again, as the last.
                queue.push_back(3, NonNull::from(&links[gone]));
            }
            let order: Vec<NonNull<Link>> = std::iter::from_fn(|| queue.pop()).collect();
            let mut expected: Vec<usize> =
                [3, 2, 0, 1].into_iter().filter(|&n| n != gone).collect();
            expected.push(gone);
            assert_eq!(
                order,
                expected
                    .into_iter()
                    .map(|n| NonNull::from(&links[n]))
                    .collect::<Vec<_>>()
            );
            assert_eq!(current::ready_levels(), 0);
        }
    }
}
