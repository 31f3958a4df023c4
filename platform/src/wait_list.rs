//! A list of those who wait, most urgent first, then first come first served.
//!
//! The nodes lie in the waiting futures, so waiting allocates nothing and a future that is dropped takes its node with it. The
//! list belongs to a lock: every method is called with that lock held.

use crate::current::{Priority, Wakeup};
use std::ptr::NonNull;

/// One who waits. A future embeds it, pinned, as the first field of a `repr(C)` structure, so that a list's node leads back to it.
#[derive(Debug)]
pub struct WaitNode {
    before: Option<NonNull<WaitNode>>,
    after: Option<NonNull<WaitNode>>,
    priority: Priority,
    wakeup: Option<Wakeup>,
}

impl WaitNode {
    /// A node that is in no list.
    pub const fn new() -> Self {
        Self {
            before: None,
            after: None,
            priority: Priority {
                thread: 0,
                level: 0,
            },
            wakeup: None,
        }
    }

    /// Whom to wake; to be changed only under the list's lock.
    pub fn wakeup_mut(&mut self) -> &mut Option<Wakeup> {
        &mut self.wakeup
    }
}

impl Default for WaitNode {
    fn default() -> Self {
        Self::new()
    }
}

/// The waiting list. Its nodes must be taken out before they move or die.
///
/// # Invariants
///
/// `first` and `last` are the ends of a doubly linked chain of live, pinned nodes, whose priorities never rise from first to last.
#[derive(Debug)]
pub struct WaitList {
    first: Option<NonNull<WaitNode>>,
    last: Option<NonNull<WaitNode>>,
}

// SAFETY: the list owns no node; the lock that guards it guards the nodes' links too, so it may go where the lock goes.
unsafe impl Send for WaitList {}

impl WaitList {
    /// An empty list.
    pub const fn new() -> Self {
        Self {
            first: None,
            last: None,
        }
    }

    /// Whether nobody waits.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.first.is_none()
    }

    /// Who is served next.
    #[inline]
    pub fn first(&self) -> Option<NonNull<WaitNode>> {
        self.first
    }

    /// Who is served after `node`.
    ///
    /// # Safety
    ///
    /// `node` is in this list.
    #[inline]
    pub unsafe fn after(&self, node: NonNull<WaitNode>) -> Option<NonNull<WaitNode>> {
        // SAFETY: by the contract the node is in this list, so by the invariant it is live.
        unsafe { node.as_ref() }.after
    }

    /// Puts `node` behind all of its priority or higher. O(1) if none of lower priority waits, else O(those of lower priority).
    ///
    /// # Safety
    ///
    /// `node` is in no list, stays where it is, and is removed before it dies.
    #[inline]
    pub unsafe fn insert(&mut self, node: NonNull<WaitNode>, priority: Priority, wakeup: Wakeup) {
        // SAFETY: by the contract the new node is live and ours; by the invariant so are all in the list.
        unsafe {
            let mut before = self.last;
            while let Some(other) = before {
                if other.as_ref().priority >= priority {
                    break;
                }
                before = other.as_ref().before;
            }
            let after = match before {
                Some(before) => before.as_ref().after,
                None => self.first,
            };
            let fields = &mut *node.as_ptr();
            fields.priority = priority;
            fields.wakeup = Some(wakeup);
            fields.before = before;
            fields.after = after;
            match before {
                Some(before) => (*before.as_ptr()).after = Some(node),
                None => self.first = Some(node),
            }
            match after {
                Some(after) => (*after.as_ptr()).before = Some(node),
                None => self.last = Some(node),
            }
        }
    }

    /// Takes `node` out. O(1).
    ///
    /// # Safety
    ///
    /// `node` is in this list.
    #[inline]
    pub unsafe fn remove(&mut self, node: NonNull<WaitNode>) {
        // SAFETY: by the contract the node is in this list, so by the invariant it and its neighbours are live.
        unsafe {
            let fields = &mut *node.as_ptr();
            match fields.before {
                Some(before) => (*before.as_ptr()).after = fields.after,
                None => self.first = fields.after,
            }
            match fields.after {
                Some(after) => (*after.as_ptr()).before = fields.before,
                None => self.last = fields.before,
            }
            fields.before = None;
            fields.after = None;
        }
    }

    /// Takes out who is served next. O(1).
    #[inline]
    pub fn pop(&mut self) -> Option<NonNull<WaitNode>> {
        let node = self.first?;
        // SAFETY: it is this list's first.
        unsafe { self.remove(node) };
        Some(node)
    }
}

impl Default for WaitList {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use std::task::{Context, Waker};

    fn order(list: &mut WaitList, nodes: &[Box<WaitNode>]) -> Vec<usize> {
        std::iter::from_fn(|| list.pop())
            .map(|node| {
                nodes
                    .iter()
                    .position(|n| NonNull::from(&**n) == node)
                    .unwrap()
            })
            .collect()
    }

    fn insert(list: &mut WaitList, node: &mut Box<WaitNode>, thread: u8, level: u8) {
        let wakeup = Wakeup::of(&Context::from_waker(Waker::noop()));
        // SAFETY: the boxes outlive the list and are in it once.
        unsafe {
            list.insert(
                NonNull::from(&mut **node),
                Priority { thread, level },
                wakeup,
            )
        };
    }

    #[test]
    fn urgent_first_then_by_arrival() {
        let mut nodes: Vec<Box<WaitNode>> = (0..6).map(|_| Box::default()).collect();
        let mut list = WaitList::new();
        for (index, (thread, level)) in [(0, 3), (0, 3), (80, 0), (0, 9), (80, 0), (0, 0)]
            .into_iter()
            .enumerate()
        {
            insert(&mut list, &mut nodes[index], thread, level);
        }
        assert_eq!(order(&mut list, &nodes), [2, 4, 3, 0, 1, 5]);
        assert!(list.is_empty());
    }

    #[test]
    fn removal_at_either_end_and_between() {
        for gone in 0..3 {
            let mut nodes: Vec<Box<WaitNode>> = (0..3).map(|_| Box::default()).collect();
            let mut list = WaitList::new();
            for node in &mut nodes {
                insert(&mut list, node, 0, 0);
            }
            // SAFETY: it is in the list.
            unsafe { list.remove(NonNull::from(&mut *nodes[gone])) };
            let left: Vec<usize> = (0..3).filter(|&n| n != gone).collect();
            assert_eq!(order(&mut list, &nodes), left);
        }
    }
}
