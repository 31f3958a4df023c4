//! STOP: an alternative without an open guard, which waits for ever. It is listed for reports.

use core::cell::UnsafeCell;
use core::marker::PhantomPinned;
use core::mem::MaybeUninit;
use core::ptr::NonNull;
use luna_core::current;
use luna_core::wait_list::WaitNode;

#[cfg(not(loom))]
pub(crate) use list::with_stopped;

#[cfg(not(loom))]
mod list {
    use luna_core::wait_list::WaitList;
    use luna_platform::lock::PiLock;

    static STOPPED: PiLock<WaitList> = PiLock::new(WaitList::new());

    /// Calls `f` with the list of stopped processes, under its lock.
    pub(crate) fn with_stopped<R>(f: impl FnOnce(&mut WaitList) -> R) -> R {
        f(&mut STOPPED.lock())
    }
}

/// A node in the list of stopped processes.
///
/// # Invariants
///
/// Once `list` was called it is pinned and its node is there, and it is unlisted when it is
/// dropped.
#[derive(Debug)]
#[repr(C)]
pub(super) struct Stop {
    is_listed: bool,
    node: UnsafeCell<MaybeUninit<WaitNode>>,
    _pinned: PhantomPinned,
}

impl Stop {
    pub(super) fn new() -> Self {
        Self {
            node: UnsafeCell::new(MaybeUninit::uninit()),
            is_listed: false,
            _pinned: PhantomPinned,
        }
    }

    fn node(&self) -> NonNull<WaitNode> {
        NonNull::from(&self.node).cast()
    }

    /// Lists the current process. O(1), or O(stopped processes of lower priority).
    ///
    /// # Safety
    ///
    /// This is pinned from now on.
    pub(super) unsafe fn list(&mut self) {
        if self.is_listed {
            return;
        }
        self.is_listed = true;
        self.node.get_mut().write(WaitNode::new());
        // A model looks at no reports, and its lock cannot be a static one.
        #[cfg(not(loom))]
        // SAFETY: the node was not listed before, so it is in no list. It is pinned, as is demanded
        // here, and its drop takes it off.
        with_stopped(|list| unsafe { list.insert(self.node(), current::priority(), None) });
        #[cfg(loom)]
        let _ = (current::priority(), self.node());
    }
}

impl Stop {
    #[cold]
    #[inline(never)]
    fn unlist(&self) {
        #[cfg(not(loom))]
        // SAFETY: it is listed, and the lock is held.
        with_stopped(|list| unsafe { list.remove(self.node()) });
    }
}

impl Drop for Stop {
    #[inline(always)]
    fn drop(&mut self) {
        if self.is_listed {
            self.unlist();
        }
    }
}
