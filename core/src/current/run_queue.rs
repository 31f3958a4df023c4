//! The run queue of an executor: the ready processes, with a queue for each level. Only the
//! executor's thread uses it.
//!
//! It is here and not with the executors, so that a partner on the same thread readies a process by
//! a few stores, without an opaque call.

use super::LEVELS;
use core::cell::Cell;
use core::ptr::NonNull;

/// The links to the neighbours in a run queue, inside the process, so that queueing allocates
/// nothing. It is in at most one queue at a time, and touched by its executor's thread alone.
#[derive(Debug)]
pub(crate) struct Link {
    next: Cell<Option<NonNull<Link>>>,
    previous: Cell<Option<NonNull<Link>>>,
    /// The level that it is queued at, or was last.
    pub(crate) level: Cell<u8>,
}

impl Link {
    /// A link that is in no queue.
    pub(crate) const fn new() -> Self {
        Self {
            next: Cell::new(None),
            previous: Cell::new(None),
            level: Cell::new(0),
        }
    }
}

/// First come first served within a level; one bit for each level that is not empty. Every
/// operation is O(1) and free of atomics.
///
/// The process that runs next lies in a *slot*. It is found there without reading the levels, and a
/// process that becomes ready while no other one is needs no links.
///
/// # Invariants
///
/// The slot is empty only if no process is ready. Its process comes before all others: at its level
/// as the first, and none is queued at a higher one. A queued link has its level. Each level is a
/// circle of live links that are in no other queue. `tails` has the last link of each circle; its
/// `next` is the first. The level's bit in `bits` says whether there is one; while there is none,
/// the tail is not read.
///
/// The most used fields come first.
#[derive(Debug)]
#[repr(C)]
pub(crate) struct RunQueue {
    slot: Cell<Option<NonNull<Link>>>,
    bits: Cell<u32>,
    pub(crate) tails: [Cell<Option<NonNull<Link>>>; LEVELS as usize],
}

impl RunQueue {
    pub(crate) const fn new() -> Self {
        Self {
            slot: Cell::new(None),
            bits: Cell::new(0),
            tails: [const { Cell::new(None) }; LEVELS as usize],
        }
    }

    /// The levels with a ready process, one bit each.
    #[inline(always)]
    pub(crate) fn bits(&self) -> u32 {
        let slot = match self.slot.get() {
            // SAFETY: by the invariant the process in the slot is live.
            Some(next) => 1 << unsafe { next.as_ref() }.level.get(),
            None => 0,
        };
        self.bits.get() | slot
    }

    /// Whether a process is ready above `level`.
    #[inline(always)]
    pub(crate) fn has_above(&self, level: u8) -> bool {
        let next = self.slot.get();
        // SAFETY: by the invariant the process in the slot is live, and no other one is queued
        // above it.
        next.is_some_and(|next| unsafe { next.as_ref() }.level.get() > level)
    }

    /// Takes over the contents of `other`, which is empty from then on. O(1); a few stores if it is
    /// empty already.
    pub(crate) fn take_over(&self, other: &RunQueue) {
        debug_assert_eq!(self.bits(), 0, "a process that is ready here is forgotten");
        self.slot.set(other.slot.take());
        let bits = other.bits.replace(0);
        self.bits.set(bits);
        // By the invariant the tail of an empty level is not read.
        if bits != 0 {
            for (own, tail) in self.tails.iter().zip(&other.tails) {
                own.set(tail.get());
            }
        }
    }

    #[inline(always)]
    fn tail(&self, level: u8) -> &Cell<Option<NonNull<Link>>> {
        &self.tails[usize::from(level % LEVELS)]
    }

    /// Puts a process behind the others of its level.
    ///
    /// # Safety
    ///
    /// `node` is live until it is popped and is in no queue. `level` is below [`LEVELS`].
    #[inline(always)]
    pub(crate) unsafe fn push_back(&self, level: u8, node: NonNull<Link>) {
        // SAFETY: the caller promises that the node is live and in no queue; by the invariant the
        // process in the slot is live.
        unsafe {
            node.as_ref().level.set(level);
            let Some(next) = self.slot.get() else {
                return self.slot.set(Some(node));
            };
            self.push_behind(next, node);
        }
    }

    /// As [`push_back`](Self::push_back), where `next` is in the slot.
    ///
    /// # Safety
    ///
    /// `next` is in the slot. `node` has its level, is live until it is popped, and is in no queue.
    #[inline(never)]
    unsafe fn push_behind(&self, next: NonNull<Link>, node: NonNull<Link>) {
        // SAFETY: the caller promises that `node` is live and in no queue, and that `next` is in
        // the slot, so it is live by the invariant. The one that runs later is linked: the slot's
        // process comes before it.
        unsafe {
            if node.as_ref().level.get() > next.as_ref().level.get() {
                self.link::<true>(next);
                self.slot.set(Some(node));
            } else {
                self.link::<false>(node);
            }
        }
    }

    /// Whether a process is ready.
    #[inline(always)]
    pub(crate) fn is_filled(&self) -> bool {
        self.slot.get().is_some()
    }

    /// As [`push_back`](Self::push_back), where no process is ready.
    ///
    /// # Safety
    ///
    /// As for [`push_back`](Self::push_back): `node` is live until it is popped and is in no queue,
    /// and `level` is below [`LEVELS`].
    #[inline(always)]
    pub(crate) unsafe fn fill(&self, level: u8, node: NonNull<Link>) {
        // SAFETY: the caller promises that the node is live.
        unsafe { node.as_ref() }.level.set(level);
        self.slot.set(Some(node));
    }

    /// Puts a process before the others of its level.
    ///
    /// # Safety
    ///
    /// As for [`push_back`](Self::push_back): `node` is live until it is popped and is in no queue,
    /// and `level` is below [`LEVELS`].
    #[inline(never)]
    pub(crate) unsafe fn push_front(&self, level: u8, node: NonNull<Link>) {
        // SAFETY: the caller promises that the node is live and in no queue; by the invariant the
        // process in the slot is live.
        unsafe {
            node.as_ref().level.set(level);
            match self.slot.get() {
                Some(next) if level < next.as_ref().level.get() => {
                    return self.link::<true>(node);
                }
                Some(next) => self.link::<true>(next),
                None => {}
            }
            self.slot.set(Some(node));
        }
    }

    /// Puts a process behind the others of its level, and takes the one that runs next. Mostly the
    /// two change places in the slot.
    ///
    /// # Safety
    ///
    /// As for [`push_back`](Self::push_back): `node` is live until it is popped and is in no queue,
    /// and `level` is below [`LEVELS`].
    #[inline(always)]
    pub(crate) unsafe fn exchange(&self, level: u8, node: NonNull<Link>) -> NonNull<Link> {
        // SAFETY: the caller promises that the node is live and in no queue, until it is pushed,
        // and that `level` is below `LEVELS`; by the invariant the process in the slot is live.
        // After a push a process is ready.
        unsafe {
            if self.bits.get() == 0 {
                node.as_ref().level.set(level);
                let Some(next) = self.slot.get() else {
                    return node;
                };
                if next.as_ref().level.get() >= level {
                    self.slot.set(Some(node));
                    return next;
                }
            }
            self.push_back(level, node);
            self.pop().unwrap_unchecked()
        }
    }

    /// Puts a process into its level, as the first or as the last.
    ///
    /// # Safety
    ///
    /// As for [`push_back`](Self::push_back): `node` is live until it is popped, and is in no
    /// level. It has its level, and the slot's process comes before it.
    #[inline(always)]
    unsafe fn link<const FIRST: bool>(&self, node: NonNull<Link>) {
        // SAFETY: the caller promises that the new node is live; by the invariant the others are.
        unsafe {
            let this = node.as_ref();
            let level = this.level.get();
            let tail = self.tail(level);
            let (bits, bit) = (self.bits.get(), 1 << level);
            if bits & bit == 0 {
                self.bits.set(bits | bit);
                this.next.set(Some(node));
                this.previous.set(Some(node));
                tail.set(Some(node));
                return;
            }
            let last = tail.get().unwrap_unchecked();
            let first = last.as_ref().next.get().unwrap_unchecked();
            this.next.set(Some(first));
            this.previous.set(Some(last));
            last.as_ref().next.set(Some(node));
            first.as_ref().previous.set(Some(node));
            if !FIRST {
                tail.set(Some(node));
            }
        }
    }

    /// Takes a process out, wherever it stands in its level.
    ///
    /// # Safety
    ///
    /// `node` is in this queue.
    pub(crate) unsafe fn remove(&self, node: NonNull<Link>) {
        if self.slot.get() == Some(node) {
            self.pop();
            return;
        }
        // SAFETY: the caller promises that the node is in this queue. It is not in the slot, so by
        // the invariant it is live and in the circle of the level that it has.
        unsafe { self.unlink(node.as_ref().level.get(), node) };
    }

    /// # Safety
    ///
    /// `node` is in the circle of `level`.
    #[inline(always)]
    unsafe fn unlink(&self, level: u8, node: NonNull<Link>) {
        // SAFETY: the caller promises that the node is in the circle; by the invariant a link in a
        // circle has neighbours, which are live.
        unsafe {
            let next = node.as_ref().next.get().unwrap_unchecked();
            if next == node {
                self.bits.set(self.bits.get() & !(1 << level));
                return;
            }
            let previous = node.as_ref().previous.get().unwrap_unchecked();
            previous.as_ref().next.set(Some(next));
            next.as_ref().previous.set(Some(previous));
            let tail = self.tail(level);
            if tail.get() == Some(node) {
                tail.set(Some(previous));
            }
        }
    }

    /// Takes the process that runs next.
    #[inline(always)]
    pub(crate) fn pop(&self) -> Option<NonNull<Link>> {
        let node = self.slot.get()?;
        let bits = self.bits.get();
        if bits == 0 {
            self.slot.set(None);
            return Some(node);
        }
        // SAFETY: `bits` is not 0, so a level is not empty.
        unsafe { self.refill(bits) };
        Some(node)
    }

    /// Puts the first process of the highest level into the slot.
    ///
    /// # Safety
    ///
    /// `bits` are those of the levels, of which one is not empty.
    #[inline(always)]
    unsafe fn refill(&self, bits: u32) {
        // SAFETY: the caller promises that a level is not empty; by the invariant that level has a
        // tail, and its links are live.
        unsafe {
            core::hint::assert_unchecked(bits != 0);
            let level = bits.ilog2() as u8;
            let last = self.tail(level).get().unwrap_unchecked();
            let first = last.as_ref().next.get().unwrap_unchecked();
            if first == last {
                self.bits.set(bits ^ 1 << level);
            } else {
                let second = first.as_ref().next.get().unwrap_unchecked();
                last.as_ref().next.set(Some(second));
                second.as_ref().previous.set(Some(last));
            }
            self.slot.set(Some(first));
        }
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
        assert_eq!(queue.bits(), 1 << 31 | 1 << 5 | 1);
        let order: Vec<usize> = core::iter::from_fn(|| queue.pop())
            .map(|node| {
                links
                    .iter()
                    .position(|link| NonNull::from(link) == node)
                    .unwrap()
            })
            .collect();
        assert_eq!(order, [1, 4, 2, 3, 0, 5]);
        assert_eq!(queue.bits(), 0);
    }

    #[test]
    fn a_queue_that_takes_over_has_the_same_order() {
        let links: Vec<Link> = (0..5).map(|_| Link::new()).collect();
        let (queue, other) = (RunQueue::new(), RunQueue::new());
        for (link, level) in links.iter().zip([4, 9, 4, 9, 31]) {
            // SAFETY: the links outlive the queue and are pushed once.
            unsafe { other.push_back(level, NonNull::from(link)) };
        }
        let bits = other.bits();
        queue.take_over(&other);
        assert_eq!((other.bits(), queue.bits()), (0, bits));
        let order: Vec<NonNull<Link>> = core::iter::from_fn(|| queue.pop()).collect();
        assert_eq!(
            order,
            [4, 1, 3, 0, 2].map(|index| NonNull::from(&links[index]))
        );
        other.take_over(&queue);
        assert_eq!(other.pop(), None);
    }

    #[test]
    fn one_that_resumes_comes_before_its_level_and_after_higher_ones() {
        let links: Vec<Link> = (0..3).map(|_| Link::new()).collect();
        let queue = RunQueue::new();
        // SAFETY: the links outlive the queue and are pushed once.
        unsafe {
            queue.push_back(3, NonNull::from(&links[0]));
            queue.push_front(3, NonNull::from(&links[1]));
            queue.push_back(4, NonNull::from(&links[2]));
        }
        let order: Vec<NonNull<Link>> = core::iter::from_fn(|| queue.pop()).collect();
        assert_eq!(order, [2, 1, 0].map(|index| NonNull::from(&links[index])));
    }

    #[test]
    fn one_that_is_taken_out_leaves_the_others_in_order() {
        for gone in 0..4 {
            let links: Vec<Link> = (0..4).map(|_| Link::new()).collect();
            let queue = RunQueue::new();
            // SAFETY: the links outlive the queue and are pushed once; the one that is taken out is
            // queued.
            unsafe {
                // 2 0 1 3, and one that is alone at its level.
                queue.push_back(3, NonNull::from(&links[0]));
                queue.push_back(3, NonNull::from(&links[1]));
                queue.push_front(3, NonNull::from(&links[2]));
                queue.push_back(5, NonNull::from(&links[3]));
                queue.remove(NonNull::from(&links[gone]));
                assert_eq!(queue.bits() & 1 << 5 != 0, gone != 3);
                // And comes again, as the last.
                queue.push_back(3, NonNull::from(&links[gone]));
            }
            let order: Vec<NonNull<Link>> = core::iter::from_fn(|| queue.pop()).collect();
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
            assert_eq!(queue.bits(), 0);
        }
    }

    /// Compared with plain lists, with a generator of a fixed seed.
    #[test]
    fn it_does_what_plain_lists_do() {
        let links: Vec<Link> = (0..12).map(|_| Link::new()).collect();
        let queue = RunQueue::new();
        let mut lists: Vec<Vec<usize>> = vec![Vec::new(); 5];
        let mut random = 7_u64;
        let mut next = |below: usize| {
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (random >> 33) as usize % below
        };
        for _ in 0..200_000 {
            let index = next(links.len());
            let place = lists.iter().position(|list| list.contains(&index));
            match (next(5), place) {
                // SAFETY: the links outlive the queue; one is pushed while it is not queued, and
                // taken out while it is.
                (0 | 1, None) => unsafe {
                    let (level, link) = (next(5), NonNull::from(&links[index]));
                    if next(3) == 0 {
                        queue.push_front(level as u8, link);
                        lists[level].insert(0, index);
                    } else {
                        queue.push_back(level as u8, link);
                        lists[level].push(index);
                    }
                },
                (0, Some(level)) => {
                    // SAFETY: one of the lists has it, so the link is in the queue; it outlives the
                    // queue.
                    unsafe { queue.remove(NonNull::from(&links[index])) };
                    lists[level].retain(|&other| other != index);
                }
                (1, Some(_)) => {}
                // A process yields: it comes behind its equals, and the first of all is taken.
                (2, None) => {
                    let level = next(5);
                    lists[level].push(index);
                    let expected = lists.iter_mut().rev().find(|list| !list.is_empty());
                    let expected = expected.map(|list| list.remove(0));
                    // SAFETY: none of the lists has it, so the link is in no queue; it outlives the
                    // queue.
                    let taken =
                        unsafe { queue.exchange(level as u8, NonNull::from(&links[index])) };
                    assert_eq!(
                        Some(taken),
                        expected.map(|first| NonNull::from(&links[first]))
                    );
                }
                _ => {
                    let expected = lists.iter_mut().rev().find(|list| !list.is_empty());
                    let expected = expected.map(|list| list.remove(0));
                    let popped = queue.pop().map(|node| {
                        let place = links.iter().position(|link| NonNull::from(link) == node);
                        place.expect("it is one of them")
                    });
                    assert_eq!(popped, expected);
                }
            }
            let levels = lists.iter().enumerate();
            let bits = levels.map(|(level, list)| u32::from(!list.is_empty()) << level);
            assert_eq!(queue.bits(), bits.sum::<u32>());
        }
    }
}
