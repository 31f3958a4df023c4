//! Waiting for the safe state.

use super::emergency::Emergency;
use super::state::{Degree, Level};
use luna_core::current::{self, PendingWake, Renewal, WakeHandle};
use luna_core::events;
use luna_core::wait_list::{WaitList, WaitNode};
use luna_platform::lock::PiLock;
use std::cell::UnsafeCell;
use std::future::Future;
use std::marker::PhantomPinned;
use std::pin::Pin;
use std::ptr::NonNull;
use std::sync::Arc;
use std::task::{Context, Poll};

/// The tasks that wait for a system's safe state.
#[derive(Debug)]
pub(crate) struct Waiting(PiLock<List>);

#[derive(Debug)]
struct List {
    waiters: WaitList,
    /// How often the waiting tasks were called.
    round: u64,
}

/// The node of a waiting task. While it is listed the list's lock guards it.
#[repr(C)]
struct Waiter {
    /// First, so that the list's node leads back to this.
    wait: WaitNode,
    is_listed: bool,
    /// How many rounds had been called when it was listed.
    round: u64,
}

impl Waiting {
    pub(super) fn new() -> Self {
        Self(PiLock::new(List {
            waiters: WaitList::new(),
            round: 0,
        }))
    }

    /// Wakes all waiting tasks, the most urgent first, but none that begins to wait meanwhile:
    /// those see the new degree. They wait again when the safe state was left again, or when they
    /// have already reported this one. O(their number); a system call for each with a sleeping
    /// thread.
    pub(super) fn wake_all(&self) {
        let round = {
            let mut list = self.0.lock();
            list.round += 1;
            list.round
        };
        while let Some(ready) = self.take(round) {
            // A panic of one waker must not keep the others asleep.
            ready.wake_contained();
        }
    }

    /// Takes out the most urgent waiter that was listed before this round. O(waiters that were
    /// listed since).
    fn take(&self, round: u64) -> Option<PendingWake> {
        let mut list = self.0.lock();
        let mut next = list.waiters.first();
        while let Some(node) = next {
            let waiter = node.cast::<Waiter>().as_ptr();
            // SAFETY: what is listed is the first field of a live waiter, which the lock guards.
            unsafe {
                if (*waiter).round < round {
                    list.waiters.remove(node);
                    (*waiter).is_listed = false;
                    let wake_handle = (*waiter).wait.wake_handle_mut().take();
                    return Some(wake_handle.map_or(PendingWake::NONE, WakeHandle::take));
                }
                next = list.waiters.after(node);
            }
        }
        None
    }
}

/// What waits for the safe state: made by `safe_state_entered` or `safe_state_edge` of its handle.
///
/// # Invariants
///
/// Once it was polled it is pinned, and leaves the list before it goes.
#[must_use = "it waits only when awaited"]
pub struct SafeStateEntered {
    emergency: Arc<Emergency>,
    waiter: UnsafeCell<Waiter>,
    /// Whether it reports each safe state once.
    is_edge: bool,
    /// The level that it has reported.
    reported: Option<Level>,
    _pinned: PhantomPinned,
}

// SAFETY: the waiter is touched under the list's lock alone, wherever the future is.
unsafe impl Send for SafeStateEntered {}
// SAFETY: `&SafeStateEntered` gives access to nothing that changes.
unsafe impl Sync for SafeStateEntered {}

impl SafeStateEntered {
    pub(super) fn new(emergency: Arc<Emergency>, is_edge: bool) -> Self {
        Self {
            emergency,
            waiter: UnsafeCell::new(Waiter {
                wait: WaitNode::new(),
                is_listed: false,
                round: 0,
            }),
            is_edge,
            reported: None,
            _pinned: PhantomPinned,
        }
    }

    /// The level that this future is to report, if the system is in one.
    fn news(&self) -> Option<Level> {
        let level = self.emergency.journal.level();
        let is_news = !self.is_edge || self.reported != Some(level);
        (level.degree() >= Degree::SafeState && is_news).then_some(level)
    }

    fn waiter(&self) -> NonNull<Waiter> {
        // SAFETY: a cell's address is never null.
        unsafe { NonNull::new_unchecked(self.waiter.get()) }
    }
}

impl Future for SafeStateEntered {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let waiter = self.waiter();
        let mut renewal = Renewal::of(cx);
        // A thread that enters the safe state sets the degree before it takes the lock: one of the
        // two sees the other.
        let news = renewal.put(|renewal| {
            let mut list = self.emergency.waiting.0.lock();
            if let Some(news) = self.news() {
                return Some(news);
            }
            // SAFETY: the lock is held that guards the waiter, which is pinned, and leaves the list
            // when the future is dropped.
            unsafe {
                if waiter.as_ref().is_listed {
                    renewal.store((*waiter.as_ptr()).wait.wake_handle_mut());
                } else if let Some(wake_handle) = renewal.take() {
                    (*waiter.as_ptr()).is_listed = true;
                    (*waiter.as_ptr()).round = list.round;
                    list.waiters
                        .insert(waiter.cast(), current::priority(), wake_handle);
                }
            }
            None
        });
        if let Some(news) = news {
            // SAFETY: nothing is moved.
            unsafe { self.get_unchecked_mut() }.reported = Some(news);
            return Poll::Ready(());
        }
        events::waits_for_other();
        Poll::Pending
    }
}

impl Drop for SafeStateEntered {
    fn drop(&mut self) {
        let waiter = self.waiter();
        let mut list = self.emergency.waiting.0.lock();
        // SAFETY: the lock is held; a waiter with `is_listed` set is in the list.
        let unused = unsafe {
            if !waiter.as_ref().is_listed {
                return;
            }
            list.waiters.remove(waiter.cast());
            (*waiter.as_ptr()).wait.wake_handle_mut().take()
        };
        drop(list);
        drop(unused);
    }
}

luna_platform::debug_fields!(SafeStateEntered);

#[cfg(test)]
mod tests;
