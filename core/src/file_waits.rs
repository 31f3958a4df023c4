//! The waits for files, found by the number of the file's descriptor.

use crate::current::{PendingWake, Priority, WakeHandle};
use crate::wait_list::{WaitList, WaitNode};
use luna_platform::reactor::{BorrowedFd, Interest, Readiness};
use std::os::fd::{AsRawFd, RawFd};
use std::ptr::NonNull;

/// Number of lists for the waits.
const LISTS: usize = 256;

/// One wait.
#[repr(C)]
pub(crate) struct Node {
    pub(crate) wait: WaitNode,
    fd: RawFd,
    pub(crate) interest: Interest,
    pub(crate) listed: bool,
}

impl Node {
    pub(crate) fn new(file: BorrowedFd<'_>, interest: Interest) -> Self {
        Self {
            wait: WaitNode::new(),
            fd: file.as_raw_fd(),
            interest,
            listed: false,
        }
    }

    /// Whether `readiness` is what it waits for.
    pub(crate) fn wants(&self, readiness: Readiness) -> bool {
        match self.interest {
            Interest::Readable => readiness.readable,
            Interest::Writable => readiness.writable,
            Interest::Both => readiness.readable || readiness.writable,
        }
    }
}

/// What both together want.
pub(crate) fn both(one: Interest, other: Interest) -> Interest {
    if one == other { one } else { Interest::Both }
}

/// All waits of one thread: in 256 lists by the number of the descriptor, most urgent first. It
/// belongs to a lock, which guards the nodes in it too.
///
/// # Invariants
///
/// A node that is `listed` is live, pinned, and in the list of its descriptor's number; no other is
/// in any.
pub(crate) struct Waits(Box<[WaitList]>);

impl Waits {
    pub(crate) fn new() -> Self {
        Self((0..LISTS).map(|_| WaitList::new()).collect())
    }

    fn list(&mut self, fd: RawFd) -> &mut WaitList {
        &mut self.0[fd as usize % LISTS]
    }

    /// # Safety
    ///
    /// `node` is in no list, stays where it is, and is removed before it dies.
    pub(crate) unsafe fn insert(
        &mut self,
        node: NonNull<Node>,
        priority: Priority,
        wake_handle: WakeHandle,
    ) {
        // SAFETY: the caller promises a node that stays where it is and is removed before it dies,
        // as the list requires. It is in no list, so no other code uses it.
        unsafe {
            let fd = node.as_ref().fd;
            self.list(fd).insert(node.cast(), priority, wake_handle);
            (*node.as_ptr()).listed = true;
        }
    }

    /// # Safety
    ///
    /// `node` is listed here.
    pub(crate) unsafe fn remove(&mut self, node: NonNull<Node>) {
        // SAFETY: the caller promises that the node is listed here: by the invariant it is live,
        // and in the list of its descriptor's number.
        unsafe {
            let fd = node.as_ref().fd;
            self.list(fd).remove(node.cast());
            (*node.as_ptr()).listed = false;
        }
    }

    /// Removes the most urgent of the waits for `fd` that are `meant`, and returns its wake.
    pub(crate) fn take(&mut self, fd: RawFd, meant: impl Fn(&Node) -> bool) -> Option<PendingWake> {
        let node = self.find(fd, meant)?;
        // SAFETY: it was found here, so it is listed, and live.
        let wake_handle = unsafe {
            self.remove(node);
            (*node.as_ptr()).wait.wake_handle_mut().take()
        };
        Some(wake_handle.map_or(PendingWake::NONE, WakeHandle::take))
    }

    /// The most urgent of the waits for `fd` that are `meant`. O(waits with descriptors equal
    /// modulo 256).
    fn find(&self, fd: RawFd, meant: impl Fn(&Node) -> bool) -> Option<NonNull<Node>> {
        let list = &self.0[fd as usize % LISTS];
        let mut nodes = list.nodes().map(NonNull::cast::<Node>);
        nodes.find(|node| {
            // SAFETY: by the invariant what is listed is live and part of a `Node`.
            let node = unsafe { node.as_ref() };
            node.fd == fd && meant(node)
        })
    }

    /// The union of the interests of all waits for `fd`.
    pub(crate) fn interest(&self, fd: RawFd) -> Option<Interest> {
        let wants = |wanted| self.find(fd, |node| node.interest == wanted).is_some();
        match (wants(Interest::Readable), wants(Interest::Writable)) {
            (true, true) => Some(Interest::Both),
            (true, false) => Some(Interest::Readable),
            (false, true) => Some(Interest::Writable),
            (false, false) => None,
        }
    }
}
