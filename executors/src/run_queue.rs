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
/// A level's `first` and `last` are the ends of a chain of live links that are in no other queue, and its bit says whether there is one.
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
            match queue.last.replace(Some(node)) {
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
        // SAFETY: the new node is live by the contract.
        unsafe { node.as_ref() }.set_next(queue.first.get());
        if queue.first.replace(Some(node)).is_none() {
            queue.last.set(Some(node));
            current::set_ready_levels(current::ready_levels() | 1 << level);
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
        if next.is_none() {
            queue.last.set(None);
            current::set_ready_levels(current::ready_levels() & !(1 << level));
        }
        Some(node)
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn highest_level_first_then_by_arrival() {
        let links: Vec<Link> = (0..6).map(|_| Link::new(|_| {})).collect();
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
        let links: Vec<Link> = (0..3).map(|_| Link::new(|_| {})).collect();
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
}
