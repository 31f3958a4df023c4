//! A wait list, ordered by priority, then first come, first served.
//!
//! The nodes lie in the waiting futures, so waiting allocates nothing and a dropped future takes
//! its node with it. The list belongs to a lock: every method is called with that lock held.

use crate::current::{self, PlainPendingWake, PlainTurn, Priority, User, WakeHandle};
use core::cell::Cell;
use core::ops::Deref;
use core::ptr::NonNull;

/// One waiter. A future embeds it, pinned, as the first field of a `repr(C)` structure, so that a
/// pointer to the node is one to the structure.
#[derive(Debug)]
#[repr(align(8))] // `Waiting` of luna-channels keeps three bits of the address, also on a 32-bit chip.
pub struct WaitNode {
    /// In a node that [waits alone](WaitNode::wait_alone): its process, and nothing else of the
    /// node is written.
    before: Cell<Link>,
    after: Cell<Link>,
    priority: Cell<Priority>,
    user: Cell<User>,
    wake_handle: Option<WakeHandle>,
}

/// A node that is in a list, or is put into one.
///
/// # Invariants
///
/// While this is used the node is live, and the lock of its list is held. Only in the `before` of a
/// node that waits alone it is another pointer, which is not used as a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Listed(NonNull<WaitNode>);

type Link = Option<Listed>;

impl Listed {
    /// # Safety
    ///
    /// Whenever this or a copy of it is used, the node is live, and the lock of the list is held.
    #[inline(always)]
    unsafe fn new(node: NonNull<WaitNode>) -> Self {
        Self(node)
    }
}

/// The fields of a node, of which others than the wake handle are cells.
impl Deref for Listed {
    type Target = WaitNode;
    #[inline(always)]
    fn deref(&self) -> &WaitNode {
        // SAFETY: by the invariant the node is live, and the lock is held, so that no other thread
        // accesses it.
        unsafe { self.0.as_ref() }
    }
}

impl WaitNode {
    /// A node that is in no list.
    pub const fn new() -> Self {
        Self {
            before: Cell::new(None),
            after: Cell::new(None),
            priority: Cell::new(Priority {
                thread: 0,
                level: 0,
            }),
            user: Cell::new(User::Outside),
            wake_handle: None,
        }
    }

    /// A node for `user`, for an empty list. Without a wake handle its owner is woken by other
    /// means.
    #[inline(always)]
    pub fn waiting(user: User, priority: Priority, wake_handle: Option<WakeHandle>) -> Self {
        Self {
            priority: Cell::new(priority),
            user: Cell::new(user),
            wake_handle,
            ..Self::new()
        }
    }

    /// Makes the node at `place` that of the current process in its plain turn, which waits alone:
    /// in no list. Only its process is written.
    ///
    /// # Safety
    ///
    /// It is room for a node that no other thread accesses.
    #[inline(always)]
    pub unsafe fn wait_alone(place: *mut WaitNode, turn: PlainTurn<'_>) {
        let process = PlainPendingWake::of_plain_turn(turn).into_pointer();
        // SAFETY: the caller promises room for a node that no other thread accesses; this field of
        // it is written, and nothing is read or dropped.
        unsafe { (&raw mut (*place).before).write(Cell::new(Some(Listed(process.cast())))) };
    }

    /// Takes the wake of a process that waits alone.
    ///
    /// # Safety
    ///
    /// The node was made by [`wait_alone`](Self::wait_alone), and only that was done with it. The
    /// caller has the lock that guards it, and takes the wake once.
    #[inline(always)]
    pub unsafe fn take_alone(place: *const WaitNode) -> PlainPendingWake {
        // SAFETY: the caller promises that `wait_alone` made the node, so the pointer is there, and
        // that it has the lock and takes the wake once, as `from_pointer` requires.
        unsafe { PlainPendingWake::from_pointer((*place).before.get().unwrap_unchecked().0.cast()) }
    }

    /// Writes the other fields of a node that waits alone, so that it can be listed. It gets the
    /// priority that its process has now.
    ///
    /// # Safety
    ///
    /// As for [`take_alone`](Self::take_alone): it has a wake handle from here on.
    pub unsafe fn complete(place: *mut WaitNode) {
        // SAFETY: the caller has the lock of a node that waits alone, as `take_alone` requires, and
        // takes its wake once. The node is in no list, so the lock's holder may write all of it.
        unsafe {
            let wake = Self::take_alone(place);
            let process = wake.process();
            let (user, priority) = (User::Process(process.id()), process.priority());
            place.write(WaitNode::waiting(user, priority, Some(wake.into())));
        }
    }

    /// Its priority when it was listed.
    #[inline]
    pub fn priority(&self) -> Priority {
        self.priority.get()
    }

    /// The waiting process: the one that listed the node.
    #[inline]
    pub fn user(&self) -> User {
        self.user.get()
    }

    /// The handle that wakes the waiter; change it only under the list's lock.
    #[inline]
    pub fn wake_handle_mut(&mut self) -> &mut Option<WakeHandle> {
        &mut self.wake_handle
    }
}

/// The wait list. Its nodes must be removed before they move or are freed.
///
/// # Invariants
///
/// `first` begins a doubly linked chain of live, pinned nodes. The `before` of the first node is
/// the last node, so a list is one word; a channel has five lists. If all nodes came by `insert`,
/// priorities never rise from first to last.
#[derive(Debug)]
pub struct WaitList {
    first: Link,
}

// SAFETY: the list owns no node, and the lock that guards the list guards the nodes' links too, so
// it may move to any thread that holds the lock.
unsafe impl Send for WaitList {}

impl WaitList {
    /// An empty list.
    pub const fn new() -> Self {
        Self { first: None }
    }

    /// Whether the list is empty.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.first.is_none()
    }

    /// The next waiter.
    #[inline]
    pub fn first(&self) -> Option<NonNull<WaitNode>> {
        self.first.map(|first| first.0)
    }

    /// The waiters, in their order. The caller has the list's lock until it is done with them.
    #[inline]
    pub fn nodes(&self) -> impl Iterator<Item = NonNull<WaitNode>> + '_ {
        self.listed().map(|node| node.0)
    }

    #[inline]
    fn listed(&self) -> impl Iterator<Item = Listed> + '_ {
        core::iter::successors(self.first, |node| node.after.get())
    }

    /// The waiter after `node`.
    ///
    /// # Safety
    ///
    /// `node` is in this list.
    #[inline]
    pub unsafe fn after(&self, node: NonNull<WaitNode>) -> Option<NonNull<WaitNode>> {
        // SAFETY: the node is in this list, as is demanded here, so it is live.
        let after = unsafe { Listed::new(node) }.after.get();
        after.map(|after| after.0)
    }

    /// Inserts `node` for the current process, behind all nodes of the same or a higher priority.
    /// O(1) if no node of lower priority is listed, else O(nodes of lower priority). Without a wake
    /// handle, its owner is woken by other means.
    ///
    /// # Safety
    ///
    /// `node` is live and in no list, stays where it is, and is removed before it is freed.
    #[inline]
    pub unsafe fn insert(
        &mut self,
        node: NonNull<WaitNode>,
        priority: Priority,
        wake_handle: impl Into<Option<WakeHandle>>,
    ) {
        let before = self.last_of(priority).map(|before| before.0);
        // SAFETY: as is demanded here: the node is live and in no list, and stays so until it is
        // removed. What comes before it is in this list.
        unsafe { self.insert_after(before, node, priority, wake_handle) };
    }

    /// Inserts a [node](WaitNode::waiting) with all its fields set into an empty list. O(1).
    ///
    /// # Safety
    ///
    /// As for `insert`: `node` is live and in no list, stays where it is, and is removed before it
    /// is freed. The list is empty.
    #[inline(always)]
    pub unsafe fn insert_into_empty(&mut self, node: NonNull<WaitNode>) {
        // SAFETY: the node is live until it is removed, as is demanded here.
        let node = unsafe { Listed::new(node) };
        node.before.set(Some(node));
        self.first = Some(node);
    }

    /// Removes the next waiter. O(1).
    ///
    /// # Safety
    ///
    /// `node` is the first of this list.
    #[inline(always)]
    pub unsafe fn remove_first(&mut self, node: NonNull<WaitNode>) {
        // SAFETY: the node is in this list, as is demanded here, so it is live.
        let node = unsafe { Listed::new(node) };
        self.first = node.after.get();
        if let Some(first) = self.first {
            first.before.set(node.before.get());
        }
    }

    /// Inserts `node`, which was in another list of the same lock, behind all nodes of the same or
    /// a higher priority. The waiter stays the same and now waits for something else. Cost as for
    /// [`insert`](Self::insert).
    ///
    /// # Safety
    ///
    /// As for `insert`: `node` is live and in no list, stays where it is, and is removed before it
    /// is freed. It was listed before, so its fields are set.
    #[inline]
    pub unsafe fn insert_again(&mut self, node: NonNull<WaitNode>) {
        // SAFETY: the node is live until it is removed, as is demanded here.
        let node = unsafe { Listed::new(node) };
        self.link(self.last_of(node.priority()), node);
    }

    /// As [`insert_again`](Self::insert_again), at another priority than before. Cost as for
    /// [`insert`](Self::insert).
    ///
    /// # Safety
    ///
    /// As for `insert`: `node` is live and in no list, stays where it is, and is removed before it
    /// is freed. It was listed before, so its fields are set.
    pub unsafe fn insert_again_at(&mut self, node: NonNull<WaitNode>, priority: Priority) {
        // SAFETY: the node is live until it is removed, as is demanded here.
        let node = unsafe { Listed::new(node) };
        node.priority.set(priority);
        self.link(self.last_of(priority), node);
    }

    /// As [`insert_again`](Self::insert_again), but before all nodes of its priority: its turn had
    /// no effect. O(nodes of higher priority).
    ///
    /// # Safety
    ///
    /// As for `insert`: `node` is live and in no list, stays where it is, and is removed before it
    /// is freed. It was listed before, so its fields are set.
    pub unsafe fn insert_again_first(&mut self, node: NonNull<WaitNode>) {
        // SAFETY: the node is live until it is removed, as is demanded here.
        let node = unsafe { Listed::new(node) };
        let is_above = |other: &Listed| other.priority() > node.priority();
        let before = self.listed().take_while(is_above).last();
        self.link(before, node);
    }

    /// The last node.
    #[inline]
    fn last(&self) -> Link {
        self.first.and_then(|first| first.before.get())
    }

    /// The last node of this priority or higher.
    #[inline]
    fn last_of(&self, priority: Priority) -> Link {
        let mut last = self.last();
        while let Some(node) = last {
            if node.priority() >= priority {
                break;
            }
            // `before` of the first node is the last one: stop there.
            let before = node.before.get();
            last = before.filter(|_| self.first != Some(node));
        }
        last
    }

    /// Inserts `node` directly behind `before`, or first, for the current process: for a list that
    /// is not ordered by priority. O(1).
    ///
    /// # Safety
    ///
    /// As for [`insert`](Self::insert): `node` is live and in no list, stays where it is, and is
    /// removed before it is freed. `before` is in this list.
    #[inline]
    pub unsafe fn insert_after(
        &mut self,
        before: Option<NonNull<WaitNode>>,
        node: NonNull<WaitNode>,
        priority: Priority,
        wake_handle: impl Into<Option<WakeHandle>>,
    ) {
        // SAFETY: the node is live and in no list, as is demanded here, so it is not shared; and it
        // is live until it is removed. `before` is in this list, so it is live.
        let (before, node) = unsafe {
            // A drop of it may run user code, and the list's lock is held.
            debug_assert!((*node.as_ptr()).wake_handle.is_none());
            (*node.as_ptr()).wake_handle = wake_handle.into();
            (before.map(|before| Listed::new(before)), Listed::new(node))
        };
        node.priority.set(priority);
        node.user.set(current::user());
        self.link(before, node);
    }

    /// Puts a node that is in no list behind `before`, which is in this one, or first.
    #[inline]
    fn link(&mut self, before: Link, node: Listed) {
        match (before, self.first) {
            (Some(before), Some(first)) => {
                let after = before.after.replace(Some(node));
                node.before.set(Some(before));
                node.after.set(after);
                // Link it before its follower, or as the last one, before the first.
                after.unwrap_or(first).before.set(Some(node));
            }
            (_, Some(first)) => {
                node.before.set(first.before.replace(Some(node)));
                node.after.set(Some(first));
                self.first = Some(node);
            }
            (_, None) => {
                node.before.set(Some(node));
                node.after.set(None);
                self.first = Some(node);
            }
        }
    }

    /// Appends all nodes of `other`, and leaves `other` empty. O(1).
    pub fn append(&mut self, other: &mut WaitList) {
        let last = other.last();
        let Some(first) = other.first.take() else {
            return;
        };
        let Some(own_first) = self.first else {
            self.first = Some(first);
            return;
        };
        let own_last = own_first.before.replace(last);
        if let Some(own_last) = own_last {
            own_last.after.set(Some(first));
        }
        first.before.set(own_last);
    }

    /// Removes `node`. O(1).
    ///
    /// # Safety
    ///
    /// `node` is in this list.
    #[inline]
    pub unsafe fn remove(&mut self, node: NonNull<WaitNode>) {
        debug_assert!(self.first.is_some(), "removed from an empty list");
        // SAFETY: the node is in this list, as is demanded here, so it is live.
        let node = unsafe { Listed::new(node) };
        let (before, after) = (node.before.take(), node.after.take());
        if self.first == Some(node) {
            self.first = after;
        } else if let Some(before) = before {
            before.after.set(after);
        }
        // Before its follower, or before the first if it was the last.
        if let Some(follower) = after.or(self.first) {
            follower.before.set(before);
        }
    }

    /// Removes the next waiter. O(1).
    #[inline]
    pub fn pop(&mut self) -> Option<NonNull<WaitNode>> {
        let node = self.first?;
        // SAFETY: it is the first node of this list.
        unsafe { self.remove_first(node.0) };
        node.after.set(None);
        Some(node.0)
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use core::task::{Context, Waker};

    fn order(list: &mut WaitList, nodes: &[Box<WaitNode>]) -> Vec<usize> {
        core::iter::from_fn(|| list.pop())
            .map(|node| {
                nodes
                    .iter()
                    .position(|n| NonNull::from(&**n) == node)
                    .unwrap()
            })
            .collect()
    }

    fn insert(list: &mut WaitList, node: &mut Box<WaitNode>, thread: u8, level: u8) {
        let wake_handle = WakeHandle::of(&Context::from_waker(Waker::noop()));
        // SAFETY: the boxes outlive the list, and each node is in it once.
        unsafe {
            list.insert(
                NonNull::from(&mut **node),
                Priority { thread, level },
                wake_handle,
            )
        };
    }

    #[test]
    fn urgent_first_then_by_arrival() {
        let mut nodes: Vec<Box<WaitNode>> = (0..6).map(|_| Box::new(WaitNode::new())).collect();
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
    fn one_that_comes_again_as_the_first_is_before_its_equals_alone() {
        let mut nodes: Vec<Box<WaitNode>> = (0..4).map(|_| Box::new(WaitNode::new())).collect();
        let mut list = WaitList::new();
        for (index, level) in [3, 3, 9, 0].into_iter().enumerate() {
            insert(&mut list, &mut nodes[index], 0, level);
        }
        // SAFETY: it is in the list, and in none afterwards.
        unsafe {
            list.remove(NonNull::from(&mut *nodes[1]));
            list.insert_again_first(NonNull::from(&mut *nodes[1]));
        }
        assert_eq!(order(&mut list, &nodes), [2, 1, 0, 3]);
    }

    #[test]
    fn one_that_comes_again_at_another_priority_stands_where_that_says() {
        let mut nodes: Vec<Box<WaitNode>> = (0..3).map(|_| Box::new(WaitNode::new())).collect();
        let mut list = WaitList::new();
        for (index, level) in [9, 3, 3].into_iter().enumerate() {
            insert(&mut list, &mut nodes[index], 0, level);
        }
        // SAFETY: it is in the list, and in none afterwards.
        unsafe {
            list.remove(NonNull::from(&mut *nodes[2]));
            let (thread, level) = (0, 20);
            list.insert_again_at(NonNull::from(&mut *nodes[2]), Priority { thread, level });
        }
        assert_eq!(order(&mut list, &nodes), [2, 0, 1]);
    }

    #[test]
    fn lists_are_joined() {
        let mut nodes: Vec<Box<WaitNode>> = (0..4).map(|_| Box::new(WaitNode::new())).collect();
        let (mut list, mut other) = (WaitList::new(), WaitList::new());
        list.append(&mut other);
        assert!(list.is_empty());
        for (index, node) in nodes.iter_mut().enumerate() {
            insert(if index < 2 { &mut list } else { &mut other }, node, 0, 0);
        }
        other.append(&mut list);
        assert!(list.is_empty());
        assert_eq!(order(&mut other, &nodes), [2, 3, 0, 1]);
    }

    #[test]
    fn removal_at_either_end_and_between() {
        for gone in 0..3 {
            let mut nodes: Vec<Box<WaitNode>> = (0..3).map(|_| Box::new(WaitNode::new())).collect();
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
