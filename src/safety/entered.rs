//! Waiting for the safe state.

use super::emergency::Emergency;
use super::state::Degree;
use luna_platform::current::{self, Ready, Wakeup};
use luna_platform::events;
use luna_platform::lock::PiLock;
use luna_platform::wait_list::{WaitList, WaitNode};
use std::cell::UnsafeCell;
use std::fmt;
use std::future::Future;
use std::marker::PhantomPinned;
use std::pin::Pin;
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, RawWakerVTable};

/// Those who wait for a system's safe state.
#[derive(Debug)]
pub(crate) struct Waiting(PiLock<WaitList>);

/// The node of one who waits.
#[repr(C)]
struct Waiter {
    /// First, so that the list's node leads back to this. The list's lock guards it while it is listed.
    wait: WaitNode,
    /// Set and cleared under the lock. Once it is cleared nobody but the future touches this.
    is_listed: AtomicBool,
}

impl Waiting {
    pub(super) fn new() -> Self {
        Self(PiLock::new(WaitList::new()))
    }

    /// Wakes all who wait, the most urgent first: the degree says by now what they wait for. O(their number); a system call for each whose thread sleeps.
    pub(super) fn wake_all(&self) {
        while let Some(ready) = self.take() {
            ready.wake();
        }
    }

    fn take(&self) -> Option<Ready> {
        let mut list = self.0.lock();
        let node = list.first()?;
        let waiter = node.cast::<Waiter>().as_ptr();
        // SAFETY: what is listed is the first field of a live waiter, which the lock guards.
        unsafe {
            list.remove(node);
            let wakeup = (*waiter).wait.wakeup_mut().take();
            (*waiter).is_listed.store(false, Ordering::Release);
            Some(wakeup.map_or(Ready::NOBODY, Wakeup::take))
        }
    }
}

/// What waits for the safe state: made by `safe_state_entered` of its handle.
///
/// # Invariants
///
/// Once it was polled it is pinned, and leaves the list before it goes.
#[must_use = "it waits only when awaited"]
pub struct SafeStateEntered {
    emergency: Arc<Emergency>,
    waiter: UnsafeCell<Waiter>,
    /// With whose waker it was listed.
    listed_for: Option<(*const (), &'static RawWakerVTable)>,
    _pinned: PhantomPinned,
}

// SAFETY: the waiter is touched under the list's lock, or when it is in no list; the waker's address is only compared.
unsafe impl Send for SafeStateEntered {}
// SAFETY: `&SafeStateEntered` gives access to nothing that changes.
unsafe impl Sync for SafeStateEntered {}

impl SafeStateEntered {
    pub(super) fn new(emergency: Arc<Emergency>) -> Self {
        Self {
            emergency,
            waiter: UnsafeCell::new(Waiter {
                wait: WaitNode::new(),
                is_listed: AtomicBool::new(false),
            }),
            listed_for: None,
            _pinned: PhantomPinned,
        }
    }

    fn node(&self) -> NonNull<WaitNode> {
        // SAFETY: a cell's address is never null.
        unsafe { NonNull::new_unchecked(self.waiter.get()) }.cast()
    }

    fn is_listed(&self) -> &AtomicBool {
        // SAFETY: the flag is an atomic at a place of its own, so others may change it and the node.
        unsafe { &(*self.waiter.get()).is_listed }
    }
}

impl Future for SafeStateEntered {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        if self.emergency.degree() >= Degree::SafeState {
            return Poll::Ready(());
        }
        let waker = Some((cx.waker().data(), cx.waker().vtable()));
        if self.is_listed().load(Ordering::Acquire) && self.listed_for == waker {
            events::waits_for_other();
            return Poll::Pending;
        }
        let wakeup = Wakeup::of(cx);
        let node = self.node();
        let mut list = self.emergency.waiting.0.lock();
        // Whoever enters it says so before it takes the lock: one of the two sees the other.
        if self.emergency.degree() >= Degree::SafeState {
            drop(list);
            return Poll::Ready(());
        }
        // SAFETY: the lock is held; the node is pinned, and leaves the list when this is dropped.
        let former = unsafe {
            if self.is_listed().load(Ordering::Relaxed) {
                (*node.as_ptr()).wakeup_mut().replace(wakeup)
            } else {
                list.insert(node, current::priority(), wakeup);
                self.is_listed().store(true, Ordering::Relaxed);
                None
            }
        };
        drop(list);
        // Dropping a waker can run anything, so not under the lock.
        drop(former);
        // SAFETY: nothing is moved.
        unsafe { self.get_unchecked_mut() }.listed_for = waker;
        events::waits_for_other();
        Poll::Pending
    }
}

impl Drop for SafeStateEntered {
    fn drop(&mut self) {
        if !self.is_listed().load(Ordering::Acquire) {
            return;
        }
        let node = self.node();
        let mut list = self.emergency.waiting.0.lock();
        // SAFETY: the lock is held; a node that says so is in the list.
        let unused = unsafe {
            if !self.is_listed().load(Ordering::Relaxed) {
                return;
            }
            list.remove(node);
            (*node.as_ptr()).wakeup_mut().take()
        };
        drop(list);
        drop(unused);
    }
}

impl fmt::Debug for SafeStateEntered {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SafeStateEntered").finish_non_exhaustive()
    }
}
