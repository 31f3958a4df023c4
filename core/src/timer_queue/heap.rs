//! An intrusive leftist heap (C. A. Crane, "Linear lists and priority queues as balanced binary
//! trees", 1972).
//!
//! Chosen over a binary heap in an array, which must grow, and over a timing wheel, which rounds
//! deadlines or cascades. Its right spines are at most log2(n + 1) long, which bounds inserting,
//! removing the first and removing any by O(log n).

use super::Fired;
use crate::current::{Priority, WakeHandle};
use luna_platform::clock::Instant;
use std::ptr::NonNull;

type Link = Option<NonNull<Node>>;

/// A deadline and its wake handle.
#[derive(Debug)]
pub(super) struct Node {
    parent: Link,
    left: Link,
    right: Link,
    pub(super) deadline: Instant,
    /// Of equal deadlines the one armed first comes first.
    sequence: u64,
    /// None of a deadline that wakes nobody.
    pub(super) wake_handle: Option<WakeHandle>,
    pub(super) label: Label,
    /// The number of nodes on the way down to the right: no more than bits of their count.
    rank: u8,
    pub(super) fired: Fired,
}

/// What the owner of a shared queue knows of a node.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Label {
    pub(super) number: u32,
    pub(super) priority: Priority,
}

impl Node {
    fn key(&self) -> (Instant, u64) {
        (self.deadline, self.sequence)
    }
}

/// The heap.
///
/// # Invariants
///
/// All nodes reached from `root` are live and pinned. A node's key is not less than its parent's. A
/// node's left rank is not less than its right one, and its own is the right one plus one.
#[derive(Debug)]
pub(super) struct Heap {
    root: Link,
    sequence: u64,
}

// SAFETY: the heap owns no node; the lock around it guards the nodes too.
unsafe impl Send for Heap {}

impl Heap {
    pub(super) fn new() -> Self {
        Self {
            root: None,
            sequence: 0,
        }
    }

    /// The node with the earliest deadline.
    pub(super) fn first(&self) -> Link {
        self.root
    }

    /// Makes a node at `place`, and adds it. O(log n).
    ///
    /// # Safety
    ///
    /// `place` is room for a node, and none in a heap. It stays where it is, and the node is
    /// removed before it is freed.
    pub(super) unsafe fn insert(
        &mut self,
        place: NonNull<Node>,
        deadline: Instant,
        wake_handle: Option<WakeHandle>,
        label: Label,
    ) {
        self.sequence += 1;
        // SAFETY: the caller promises that there is room for the new node, which is in no heap; by
        // the invariants the others are live.
        unsafe {
            place.write(Node {
                parent: None,
                left: None,
                right: None,
                deadline,
                sequence: self.sequence,
                wake_handle,
                label,
                rank: 1,
                fired: Fired::new(false),
            });
            self.root = merge(self.root, Some(place));
        }
    }

    /// Removes a node. O(log n).
    ///
    /// # Safety
    ///
    /// `node` is in this heap.
    pub(super) unsafe fn remove(&mut self, node: NonNull<Node>) {
        // SAFETY: the caller promises that the node is in this heap, so by the invariants it and
        // its descendants are live.
        unsafe {
            let Node {
                parent,
                left,
                right,
                ..
            } = *node.as_ptr();
            let children = merge(left, right);
            if let Some(children) = children {
                (*children.as_ptr()).parent = parent;
            }
            match parent {
                None => self.root = children,
                Some(above) => {
                    if (*above.as_ptr()).left == Some(node) {
                        (*above.as_ptr()).left = children;
                    } else {
                        (*above.as_ptr()).right = children;
                    }
                    // Go up while ranks change, which is at most log2(n + 1) steps.
                    let mut next = parent;
                    while let Some(ancestor) = next {
                        if !restore(ancestor) {
                            break;
                        }
                        next = (*ancestor.as_ptr()).parent;
                    }
                }
            }
        }
    }
}

/// Puts the child of higher rank on the left and sets the rank; returns whether the rank changed.
///
/// # Safety
///
/// `node` and its children are live.
unsafe fn restore(node: NonNull<Node>) -> bool {
    // SAFETY: the caller promises that the node and its children are live.
    unsafe {
        let rank = |link: Link| link.map_or(0, |child| (*child.as_ptr()).rank);
        let fields = &mut *node.as_ptr();
        if rank(fields.left) < rank(fields.right) {
            std::mem::swap(&mut fields.left, &mut fields.right);
        }
        let new = rank(fields.right) + 1;
        std::mem::replace(&mut fields.rank, new) != new
    }
}

/// Joins two heaps. The function does not set the parent of the resulting root.
///
/// # Safety
///
/// All nodes of both are live, and the heaps share none.
unsafe fn merge(a: Link, b: Link) -> Link {
    let (Some(a), Some(b)) = (a, b) else {
        return a.or(b);
    };
    // SAFETY: the caller promises that all nodes of both heaps are live.
    unsafe {
        let less = |x: NonNull<Node>, y: NonNull<Node>| (*x.as_ptr()).key() < (*y.as_ptr()).key();
        let (root, mut other) = if less(a, b) { (a, b) } else { (b, a) };
        (*root.as_ptr()).parent = None;
        // Down the right spine: at each place the lesser of the node there and the one to be
        // placed.
        let mut place = root;
        while let Some(there) = (*place.as_ptr()).right {
            let (here, rest) = if less(other, there) {
                (other, there)
            } else {
                (there, other)
            };
            (*place.as_ptr()).right = Some(here);
            (*here.as_ptr()).parent = Some(place);
            place = here;
            other = rest;
        }
        (*place.as_ptr()).right = Some(other);
        (*other.as_ptr()).parent = Some(place);
        // Up again: every node of the way has a new right child.
        let mut next = Some(place);
        while let Some(node) = next {
            restore(node);
            next = (*node.as_ptr()).parent;
        }
        Some(root)
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use std::mem::MaybeUninit;

    /// A small generator of fixed sequences, so that the test needs no crate.
    fn random(state: &mut u64) -> u64 {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        *state
    }

    fn check(link: Link, parent: Link) -> (u8, usize) {
        let Some(node) = link else { return (0, 0) };
        // SAFETY: the test's nodes live in boxes.
        let node_ref = unsafe { node.as_ref() };
        assert_eq!(node_ref.parent, parent);
        if let Some(parent) = parent {
            // SAFETY: the test's nodes live in boxes.
            assert!(unsafe { parent.as_ref() }.key() <= node_ref.key());
        }
        let (left, left_count) = check(node_ref.left, link);
        let (right, right_count) = check(node_ref.right, link);
        assert!(left >= right);
        assert_eq!(node_ref.rank, right + 1);
        (node_ref.rank, left_count + right_count + 1)
    }

    #[test]
    fn random_inserts_and_removals_keep_order_and_shape() {
        let mut state = 0x9E37_79B9_7F4A_7C15_u64;
        let mut nodes: Vec<Box<MaybeUninit<Node>>> =
            (0..300).map(|_| Box::new(MaybeUninit::uninit())).collect();
        let mut inside = vec![false; nodes.len()];
        let mut heap = Heap::new();
        for _ in 0..20_000 {
            let index = (random(&mut state) % nodes.len() as u64) as usize;
            let node = NonNull::from(&mut *nodes[index]).cast();
            // SAFETY: the boxes outlive the heap; `inside` says which are in it.
            unsafe {
                if inside[index] {
                    heap.remove(node);
                } else {
                    let deadline = Instant::from_nanos(random(&mut state) % 50);
                    heap.insert(node, deadline, None, Label::default());
                }
            }
            inside[index] = !inside[index];
        }
        let (_, count) = check(heap.first(), None);
        assert_eq!(count, inside.iter().filter(|&&x| x).count());
        let mut last = (Instant::from_nanos(0), 0);
        while let Some(first) = heap.first() {
            // SAFETY: it is in the heap.
            unsafe {
                assert!(first.as_ref().key() > last);
                last = first.as_ref().key();
                heap.remove(first);
            }
        }
    }
}
