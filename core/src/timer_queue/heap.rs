//! An intrusive leftist heap (C. A. Crane, "Linear lists and priority queues as balanced binary
//! trees", 1972).
//!
//! Chosen over a binary heap in an array, which must grow, and over a timing wheel, which rounds
//! deadlines or cascades. Its right spines are at most log2(n + 1) long, which bounds inserting,
//! removing the first and removing any by O(log n).

use crate::current::{Priority, Renewal, WakeHandle};
use core::cell::Cell;
use core::ops::Deref;
use core::ptr::NonNull;
use luna_platform::clock::Instant;
use luna_platform::sync::atomic::{AtomicBool, Ordering};

type Link = Option<Listed>;

/// A deadline and its wake handle. The cells are guarded by the lock around the heap.
pub(super) struct Node {
    parent: Cell<Link>,
    left: Cell<Link>,
    right: Cell<Link>,
    deadline: Instant,
    /// Of equal deadlines the one armed first comes first.
    sequence: u64,
    /// None of a deadline that wakes nobody.
    wake_handle: Cell<Option<WakeHandle>>,
    label: Label,
    /// The number of nodes on the way down to the right: no more than bits of their count.
    rank: Cell<u8>,
    fired: AtomicBool,
}

/// A node of a heap, or one that is put into it.
///
/// # Invariants
///
/// While this is used the node is live, and the lock around its heap is held. It is not used after
/// `fired` was set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Listed(NonNull<Node>);

impl Listed {
    /// # Safety
    ///
    /// Whenever this or a copy of it is used, the node is live, and the lock around the heap is held.
    #[inline(always)]
    unsafe fn new(node: NonNull<Node>) -> Self {
        Self(node)
    }
}

impl Deref for Listed {
    type Target = Node;
    #[inline(always)]
    fn deref(&self) -> &Node {
        // SAFETY: by the invariant the node is live, and the lock is held, so that no other thread
        // accesses its cells.
        unsafe { self.0.as_ref() }
    }
}

/// What the owner of a shared queue knows of a node.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Label {
    /// Of a `Deadline`, which wakes no process; 0 for waits.
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

    /// The earliest deadline.
    #[inline]
    pub(super) fn first_deadline(&self) -> Option<Instant> {
        self.root.map(|root| root.deadline)
    }

    /// Takes out the node with the earliest deadline, which has fired then: its owner may free it.
    /// O(log n).
    #[inline(always)]
    pub(super) fn pop(&mut self) -> Option<(Option<WakeHandle>, Instant, Label)> {
        let first = self.root?;
        // SAFETY: the root of this heap is in it.
        unsafe { self.remove(first.0) };
        let (deadline, label) = (first.deadline, first.label);
        let wake_handle = first.wake_handle.take();
        first.fired.store(true, Ordering::Release);
        Some((wake_handle, deadline, label))
    }

    /// Whether the node has fired. From any thread, without the lock.
    ///
    /// # Safety
    ///
    /// It was inserted, and is live.
    #[inline]
    pub(super) unsafe fn has_fired(node: NonNull<Node>) -> bool {
        // SAFETY: the node was inserted, so it was written, and is live, as is demanded here. This
        // field is atomic, and no other is accessed.
        unsafe { (*node.as_ptr()).fired.load(Ordering::Acquire) }
    }

    /// Lets the context of `renewal` be woken. A node that has just fired stays without a handle:
    /// it is ready at its next poll.
    ///
    /// # Safety
    ///
    /// The node was inserted into this heap, and is live.
    pub(super) unsafe fn renew(&mut self, node: NonNull<Node>, renewal: &mut Renewal<'_, '_>) {
        // SAFETY: the node was inserted here, and is live, as is demanded here.
        let node = unsafe { Listed::new(node) };
        let wake_handle = &node.wake_handle;
        let mut stored = wake_handle.take();
        if stored.is_some() {
            renewal.store(&mut stored);
        }
        wake_handle.set(stored);
    }

    /// Removes a node that has not fired, and gives its wake handle. O(log n).
    ///
    /// # Safety
    ///
    /// The node was inserted into this heap, was not withdrawn since, and is live.
    #[inline(always)]
    pub(super) unsafe fn withdraw(&mut self, node: NonNull<Node>) -> Option<Option<WakeHandle>> {
        // SAFETY: the caller promises that the node was inserted here, was not withdrawn since, and
        // is live. If it has not fired, `pop` has not taken it out either: it is in this heap.
        unsafe {
            let listed = Listed::new(node);
            if listed.fired.load(Ordering::Relaxed) {
                return None;
            }
            self.remove(node);
            Some(listed.wake_handle.take())
        }
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
        // SAFETY: the caller promises that there is room for the new node, which is in no heap and
        // stays there until it is removed.
        let node = unsafe {
            place.write(Node {
                parent: Cell::new(None),
                left: Cell::new(None),
                right: Cell::new(None),
                deadline,
                sequence: self.sequence,
                wake_handle: Cell::new(wake_handle),
                label,
                rank: Cell::new(1),
                fired: AtomicBool::new(false),
            });
            Listed::new(place)
        };
        self.root = merge(self.root, Some(node));
    }

    /// Removes a node. O(log n).
    ///
    /// # Safety
    ///
    /// `node` is in this heap.
    pub(super) unsafe fn remove(&mut self, node: NonNull<Node>) {
        // SAFETY: the node is in this heap, as is demanded here, so it is live.
        let node = unsafe { Listed::new(node) };
        let parent = node.parent.get();
        let children = merge(node.left.get(), node.right.get());
        if let Some(children) = children {
            children.parent.set(parent);
        }
        let Some(above) = parent else {
            self.root = children;
            return;
        };
        if above.left.get() == Some(node) {
            above.left.set(children);
        } else {
            above.right.set(children);
        }
        // Go up while ranks change, which is at most log2(n + 1) steps.
        let mut next = parent;
        while let Some(ancestor) = next
            && restore(&ancestor)
        {
            next = ancestor.parent.get();
        }
    }
}

/// Puts the child of higher rank on the left and sets the rank; returns whether the rank changed.
fn restore(node: &Node) -> bool {
    let rank = |link: Link| link.map_or(0, |child| child.rank.get());
    let (left, right) = (node.left.get(), node.right.get());
    let (of_left, of_right) = (rank(left), rank(right));
    if of_left < of_right {
        node.left.set(right);
        node.right.set(left);
    }
    let new = of_left.min(of_right) + 1;
    node.rank.replace(new) != new
}

/// Joins two heaps, which share no node. The function does not set the parent of the resulting
/// root.
fn merge(a: Link, b: Link) -> Link {
    let (Some(a), Some(b)) = (a, b) else {
        return a.or(b);
    };
    let less = |x: Listed, y: Listed| x.key() < y.key();
    let (root, mut other) = if less(a, b) { (a, b) } else { (b, a) };
    root.parent.set(None);
    // Down the right spine: at each place the lesser of the node there and the one to be placed.
    let mut place = root;
    while let Some(there) = place.right.get() {
        let (here, rest) = if less(other, there) {
            (other, there)
        } else {
            (there, other)
        };
        place.right.set(Some(here));
        here.parent.set(Some(place));
        place = here;
        other = rest;
    }
    place.right.set(Some(other));
    other.parent.set(Some(place));
    // Up again: every node of the way has a new right child.
    let mut next = Some(place);
    while let Some(node) = next {
        restore(&node);
        next = node.parent.get();
    }
    Some(root)
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use core::mem::MaybeUninit;

    /// A small generator of fixed sequences, so that the test needs no crate.
    fn random(state: &mut u64) -> u64 {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        *state
    }

    fn check(link: Link, parent: Link) -> (u8, usize) {
        let Some(node) = link else { return (0, 0) };
        assert_eq!(node.parent.get(), parent);
        assert!(parent.is_none_or(|parent| parent.key() <= node.key()));
        let (left, left_count) = check(node.left.get(), link);
        let (right, right_count) = check(node.right.get(), link);
        assert!(left >= right);
        assert_eq!(node.rank.get(), right + 1);
        (node.rank.get(), left_count + right_count + 1)
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
        let (_, count) = check(heap.root, None);
        assert_eq!(count, inside.iter().filter(|&&x| x).count());
        let mut last = (Instant::from_nanos(0), 0);
        while let Some(first) = heap.root {
            assert!(first.key() > last);
            last = first.key();
            assert_eq!(heap.pop().map(|(_, deadline, _)| deadline), Some(last.0));
        }
    }
}
