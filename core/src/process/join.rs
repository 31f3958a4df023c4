//! Waiting for the end of a process.

use super::{Exit, Process};
use crate::current::{self, ProcessId, Renewal, User, WakeHandle};
use crate::events;
use crate::wait_list::WaitNode;
use alloc::vec::Vec;
use core::cell::{Cell, UnsafeCell};
use core::future::Future;
use core::marker::PhantomPinned;
use core::pin::Pin;
use core::ptr::NonNull;
use core::sync::atomic::{AtomicBool, Ordering};
use core::task::{Context, Poll};

#[derive(Debug)]
#[repr(C)]
/// The node of a waiter, in the list of the process' end.
pub(super) struct JoinNode {
    /// First, so that the list's node leads back to this.
    wait: WaitNode,
    /// Cleared, as the last access to the node, by the thread that takes it off the list.
    listed: AtomicBool,
}

impl JoinNode {
    /// Takes the wake handle out of a node that was just taken off the list.
    ///
    /// # Safety
    ///
    /// `node` is that of a join, which is live; the lock that guards it is held. It is not used any
    /// more.
    pub(super) unsafe fn unlisted(node: NonNull<WaitNode>) -> Option<WakeHandle> {
        let node = node.cast::<JoinNode>().as_ptr();
        // SAFETY: the caller promises that the node is live, and that the lock is held.
        unsafe {
            let wake_handle = (*node).wait.wake_handle_mut().take();
            (*node).listed.store(false, Ordering::Release);
            wake_handle
        }
    }
}

/// Waits for the end of a process: see [`ProcessHandle::join`](crate::ProcessHandle::join).
///
/// # Invariants
///
/// `node` is accessed under the process' lock alone, once it is listed, but for `listed`; while
/// that is so it is in the process' list.
#[must_use = "a join does nothing unless awaited"]
pub struct Join<'a> {
    process: &'a Process,
    node: UnsafeCell<JoinNode>,
    /// Whether the node may be in the list. The future's own.
    may_be_listed: Cell<bool>,
    _pinned: PhantomPinned,
}

// SAFETY: the node is guarded by the process' lock, wherever the future is.
unsafe impl Send for Join<'_> {}
// SAFETY: `&Join` gives access to nothing; only code that has the future pinned, or drops it, uses
// the cell.
unsafe impl Sync for Join<'_> {}

impl<'a> Join<'a> {
    pub(super) fn new(process: &'a Process) -> Self {
        Self {
            process,
            node: UnsafeCell::new(JoinNode {
                wait: WaitNode::new(),
                listed: AtomicBool::new(false),
            }),
            may_be_listed: Cell::new(false),
            _pinned: PhantomPinned,
        }
    }
}

impl Future for Join<'_> {
    type Output = Exit;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Exit> {
        let node = NonNull::from(&self.node).cast::<JoinNode>();
        // SAFETY: it is atomic, and the future's own.
        let listed = unsafe { &(*node.as_ptr()).listed };
        // The thread that ended the process takes the nodes off one by one, perhaps not this one
        // yet.
        let ended = |exit| {
            let may_be_listed = self.may_be_listed.get() && listed.load(Ordering::Acquire);
            self.may_be_listed.set(may_be_listed);
            Poll::Ready(exit)
        };
        if let Some(exit) = self.process.exit() {
            return ended(exit);
        }
        let mut renewal = Renewal::of(cx);
        let has_ended = renewal.put(|renewal| {
            let mut shown = self.process.record.shown.lock();
            if self.process.has_ended() {
                return true;
            }
            // SAFETY: the lock is held; the node is pinned with the future and leaves the list
            // before it dies.
            unsafe {
                if listed.load(Ordering::Relaxed) {
                    renewal.store((*node.as_ptr()).wait.wake_handle_mut());
                } else if let Some(wake_handle) = renewal.take() {
                    self.may_be_listed.set(true);
                    shown
                        .joining
                        .insert(node.cast(), current::priority(), wake_handle);
                    listed.store(true, Ordering::Relaxed);
                }
            }
            false
        });
        if has_ended {
            return self.process.exit().map_or(Poll::Pending, ended);
        }
        events::waits_for_other();
        Poll::Pending
    }
}

impl Drop for Join<'_> {
    fn drop(&mut self) {
        if !self.may_be_listed.get() {
            return;
        }
        let mut shown = self.process.record.shown.lock();
        let node = NonNull::from(&self.node).cast::<JoinNode>();
        // SAFETY: the lock is held, and `listed` shows whether the node is in the list.
        unsafe {
            if (*node.as_ptr()).listed.load(Ordering::Relaxed) {
                shown.joining.remove(node.cast());
            }
        }
    }
}

/// The processes that wait for the end of `process`.
pub(super) fn joiners(process: &Process) -> Vec<ProcessId> {
    // Room is made without the lock, for as many as were there when it was held.
    let mut joiners = Vec::new();
    loop {
        let room = joiners.capacity();
        let mut count = 0;
        {
            let shown = process.record.shown.lock();
            let mut next = shown.joining.first();
            while let Some(node) = next {
                // SAFETY: a node in the list is live, and guarded by the lock that is held.
                let user = unsafe {
                    next = shown.joining.after(node);
                    node.as_ref().user()
                };
                count += 1;
                if let User::Process(id) = user
                    && count <= room
                {
                    joiners.push(id);
                }
            }
        }
        if count <= room {
            return joiners;
        }
        joiners = Vec::with_capacity(count);
    }
}

luna_platform::debug_fields!(Join<'_>, |join| process: join.process.id());
