//! Waiting for the safe state.

use super::emergency::Emergency;
use super::state::{Degree, Level};
use luna_core::current::{self, PendingWake, WakeHandle};
use luna_core::events;
use luna_core::wait_list::{WaitList, WaitNode};
use luna_platform::lock::PiLock;
use std::cell::UnsafeCell;
use std::future::Future;
use std::marker::PhantomPinned;
use std::pin::Pin;
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, RawWakerVTable};

/// The tasks that wait for a system's safe state.
#[derive(Debug)]
pub(crate) struct Waiting(PiLock<Lists>);

/// Two lists, so that waking ends: a task that begins to wait while others are woken joins
/// `waiting`, not `called`. It does so when the safe state was left again, or when it has already
/// reported this one.
#[derive(Debug)]
struct Lists {
    waiting: WaitList,
    /// The tasks that waited when it was entered last, and are still to be woken.
    called: WaitList,
    /// How often the waiting tasks were called.
    round: u32,
}

impl Lists {
    /// Calls the waiting tasks. Returns the number of this round. O(1) if those of the round before
    /// have been woken.
    fn call(&mut self) -> u32 {
        self.round = self.round.wrapping_add(1);
        if self.called.is_empty() {
            std::mem::swap(&mut self.waiting, &mut self.called);
        }
        while let Some(node) = self.waiting.first() {
            // SAFETY: the first is listed here, and in no list then.
            unsafe {
                self.waiting.remove_first(node);
                self.called.insert_again(node);
            }
        }
        self.round
    }

    /// The list of a task that was listed in this round.
    fn of_round(&mut self, round: u32) -> &mut WaitList {
        if round == self.round {
            &mut self.waiting
        } else {
            &mut self.called
        }
    }
}

/// The node of a waiting task.
#[repr(C)]
struct Waiter {
    /// First, so that the list's node leads back to this. The list's lock guards it while it is
    /// listed.
    wait: WaitNode,
    /// Set and cleared under the lock. Once it is cleared, only the future touches the node.
    is_listed: AtomicBool,
    /// In which round it was listed. The lock guards it.
    round: u32,
}

impl Waiting {
    pub(super) fn new() -> Self {
        Self(PiLock::new(Lists {
            waiting: WaitList::new(),
            called: WaitList::new(),
            round: 0,
        }))
    }

    /// Wakes all waiting tasks, the most urgent first, but none that begins to wait meanwhile:
    /// those see the new degree. O(their number); a system call for each with a sleeping thread.
    pub(super) fn wake_all(&self) {
        let round = self.0.lock().call();
        while let Some(ready) = self.take(round) {
            // A panic of one waker must not keep the others asleep.
            ready.wake_contained();
        }
    }

    fn take(&self, round: u32) -> Option<PendingWake> {
        let mut lists = self.0.lock();
        if lists.round != round {
            // A thread that has entered the safe state since then wakes the rest.
            return None;
        }
        let node = lists.called.first()?;
        let waiter = node.cast::<Waiter>().as_ptr();
        // SAFETY: what is listed is the first field of a live waiter, which the lock guards.
        unsafe {
            lists.called.remove_first(node);
            let wake_handle = (*waiter).wait.wake_handle_mut().take();
            (*waiter).is_listed.store(false, Ordering::Release);
            Some(wake_handle.map_or(PendingWake::NONE, WakeHandle::take))
        }
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
    /// The waker with which it was listed.
    listed_for: Option<(*const (), &'static RawWakerVTable)>,
    _pinned: PhantomPinned,
}

// SAFETY: the waiter is touched under the list's lock, or when it is in no list; the waker's
// address is only compared.
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
                round: 0,
            }),
            is_edge: false,
            reported: None,
            listed_for: None,
            _pinned: PhantomPinned,
        }
    }

    pub(super) fn edge(emergency: Arc<Emergency>) -> Self {
        let mut edge = Self::new(emergency);
        edge.is_edge = true;
        edge
    }

    /// The level that this future is to report, if the system is in one.
    fn news(&self) -> Option<Level> {
        let level = self.emergency.journal.level();
        let is_news = !self.is_edge || self.reported != Some(level);
        (level.degree() >= Degree::SafeState && is_news).then_some(level)
    }

    /// Reports it.
    fn report(self: Pin<&mut Self>, news: Level) -> Poll<()> {
        // SAFETY: nothing is moved.
        unsafe { self.get_unchecked_mut() }.reported = Some(news);
        Poll::Ready(())
    }

    fn node(&self) -> NonNull<WaitNode> {
        // SAFETY: a cell's address is never null.
        unsafe { NonNull::new_unchecked(self.waiter.get()) }.cast()
    }

    fn is_listed(&self) -> &AtomicBool {
        // SAFETY: the flag is an atomic at a place of its own, so others may change it and the
        // node.
        unsafe { &(*self.waiter.get()).is_listed }
    }
}

impl Future for SafeStateEntered {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        if let Some(news) = self.news() {
            return self.report(news);
        }
        let waker = Some((cx.waker().data(), cx.waker().vtable()));
        if self.is_listed().load(Ordering::Acquire) && self.listed_for == waker {
            events::waits_for_other();
            return Poll::Pending;
        }
        let wake_handle = WakeHandle::of(cx);
        let node = self.node();
        let mut lists = self.emergency.waiting.0.lock();
        // A thread that enters the safe state sets the degree before it takes the lock: one of the
        // two sees the other.
        if let Some(news) = self.news() {
            drop(lists);
            return self.report(news);
        }
        // SAFETY: the lock is held; the node is pinned, and leaves the list when this is dropped.
        let former = unsafe {
            if self.is_listed().load(Ordering::Relaxed) {
                (*node.as_ptr()).wake_handle_mut().replace(wake_handle)
            } else {
                (*self.waiter.get()).round = lists.round;
                lists.waiting.insert(node, current::priority(), wake_handle);
                self.is_listed().store(true, Ordering::Relaxed);
                None
            }
        };
        drop(lists);
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
        let mut lists = self.emergency.waiting.0.lock();
        // SAFETY: the lock is held; a node with `is_listed` set is in the list of its round, since
        // both change under the lock only.
        let unused = unsafe {
            if !self.is_listed().load(Ordering::Relaxed) {
                return;
            }
            lists.of_round((*self.waiter.get()).round).remove(node);
            (*node.as_ptr()).wake_handle_mut().take()
        };
        drop(lists);
        drop(unused);
    }
}

debug_parts!(SafeStateEntered);

#[cfg(test)]
mod tests;
