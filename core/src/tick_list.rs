//! The waits for the ticks of a timer thread.
//!
//! The timer thread sleeps until a tick, calls [`TickList::fire`] for it, and wakes the due waiters
//! once no lock is held. The nodes lie in the waiting futures: waiting, firing and cancelling
//! allocate nothing.
//!
//! A wait that begins while its tick is being fired is not lost: the list records how far it was
//! fired, and both happen under its lock. Either the wait is listed first, and fired; or it sees
//! that its instant has passed, and does not begin.

use crate::current::{self, PendingWake, Priority, Renewal, WakeHandle};
use crate::wait_list::{WaitList, WaitNode};
use luna_platform::clock::Instant;
use luna_platform::lock::PiLock;
use luna_platform::sync::atomic::{AtomicBool, Ordering};
use std::cell::UnsafeCell;
use std::fmt;
use std::future::Future;
use std::marker::PhantomPinned;
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll};

/// The waits for the ticks of one timer, ordered by priority, then first come, first served.
///
/// Its lock is held for O(waiting) at most: by `fire`, and by a wait that begins behind others of
/// higher priority.
///
/// ```
/// use luna_platform::clock::Instant;
/// use luna_core::park;
/// use luna_core::tick_list::{Due, TickList, Woken};
///
/// let list = TickList::new();
/// let at = Instant::from_nanos(1_000);
/// assert!(list.fire(at, &mut Due::with_room_for(1)), "nobody waits");
/// // A wait that comes after its tick does not begin.
/// assert_eq!(park::block_on(list.wait(at)), Woken::ByTick);
/// list.close();
/// let later = Instant::from_nanos(2_000);
/// assert_eq!(park::block_on(list.wait(later)), Woken::ByEnd);
/// ```
#[derive(Debug)]
pub struct TickList {
    waiting: PiLock<Waiting>,
}

#[derive(Debug)]
struct Waiting {
    list: WaitList,
    /// All waits up to this instant have been fired.
    fired_until: Instant,
    /// The list is not fired any more.
    is_closed: bool,
}

/// Why a wait ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Woken {
    /// Its tick fired.
    ByTick,
    /// The list was closed: it is not fired any more, and the instant may lie ahead.
    ByEnd,
}

/// The due waiters, to be woken when no lock is held.
#[derive(Debug)]
pub struct Due {
    entries: Vec<(Priority, usize, PendingWake)>,
    /// The number of lists that have added to it.
    lists: usize,
}

impl Due {
    /// Room for `most` waiters at a time, at least one. Allocates.
    pub fn with_room_for(most: usize) -> Self {
        Self {
            entries: Vec::with_capacity(most.max(1)),
            lists: 0,
        }
    }

    /// Wakes all in order of priority, and in the order of adding within one priority. Returns
    /// their number. O(n) for one list, else O(n log n).
    pub fn wake(&mut self) -> usize {
        if std::mem::take(&mut self.lists) > 1 {
            // Unstable: the stable sort allocates.
            self.entries.sort_unstable_by_key(|&(priority, number, _)| {
                (std::cmp::Reverse(priority), number)
            });
        }
        let number = self.entries.len();
        for (_, _, ready) in self.entries.drain(..) {
            ready.wake_contained();
        }
        number
    }
}

impl TickList {
    /// An empty list.
    #[expect(
        clippy::new_without_default,
        reason = "a list belongs to a timer: made on purpose, not by default"
    )]
    pub fn new() -> Self {
        Self {
            waiting: PiLock::new(Waiting {
                list: WaitList::new(),
                fired_until: Instant::from_nanos(0),
                is_closed: false,
            }),
        }
    }

    /// Removes all waits with an instant of `now` or before, and adds them to `due`, most urgent
    /// first. `false` if `due` has no room for all: wake it and call again. O(waiting).
    pub fn fire(&self, now: Instant, due: &mut Due) -> bool {
        due.lists += 1;
        let mut waiting = self.waiting.lock();
        let mut next = waiting.list.first();
        while let Some(node) = next {
            // SAFETY: a node in the list is the first field of a live `Node`, and the list's lock
            // is held.
            unsafe {
                next = waiting.list.after(node);
                if node.cast::<Node>().as_ref().at > now {
                    continue;
                }
                if due.entries.len() == due.entries.capacity() {
                    return false;
                }
                let ready = waiting
                    .take_off(node)
                    .map_or(PendingWake::NOBODY, WakeHandle::take);
                due.entries
                    .push((node.as_ref().priority(), due.entries.len(), ready));
                node.cast::<Node>().as_ref().leave(Left::Fired);
            }
        }
        waiting.fired_until = waiting.fired_until.max(now);
        true
    }

    /// Ends all waits, and each that begins later: the list is not fired any more. Not for the
    /// real-time path.
    pub fn close(&self) {
        self.waiting.lock().is_closed = true;
        loop {
            let mut waiting = self.waiting.lock();
            let Some(node) = waiting.list.first() else {
                return;
            };
            // SAFETY: as in `fire`: the node is the first field of a live `Node`, and the lock is
            // held.
            let ready = unsafe {
                let wakeup = waiting.take_off(node);
                node.cast::<Node>().as_ref().leave(Left::Closed);
                wakeup.map_or(PendingWake::NOBODY, WakeHandle::take)
            };
            drop(waiting);
            ready.wake_contained();
        }
    }

    /// Waits until the list is fired at `at` or later. The thread that fires the list must know of
    /// `at` before.
    ///
    /// Real-time path: yes; O(waiters of lower priority), no allocation, no system call but for a
    /// contended lock. Cancel-safe: dropping it ends the wait.
    pub fn wait(&self, at: Instant) -> TickWait<'_> {
        TickWait {
            list: self,
            is_listed: false,
            node: UnsafeCell::new(Node {
                node: WaitNode::new(),
                at,
                is_fired: AtomicBool::new(false),
                is_closed: AtomicBool::new(false),
            }),
            _pinned: PhantomPinned,
        }
    }
}

impl Waiting {
    /// Removes `node`; returns the wake handle of its owner.
    ///
    /// # Safety
    ///
    /// It is in the list, and the list's lock is held.
    #[must_use = "to be woken or dropped without the lock"]
    unsafe fn take_off(&mut self, node: NonNull<WaitNode>) -> Option<WakeHandle> {
        // SAFETY: the caller promises that the node is in this list and the lock is held.
        unsafe {
            self.list.remove(node);
            (*node.as_ptr()).wakeup_mut().take()
        }
    }
}

/// Why a node has left the list.
enum Left {
    Fired,
    Closed,
}

/// One waiter.
#[repr(C)]
struct Node {
    node: WaitNode,
    at: Instant,
    /// It has left the list: from then on only its owner uses it.
    is_fired: AtomicBool,
    /// It left because the list was closed. Written before `is_fired`.
    is_closed: AtomicBool,
}

impl Node {
    /// Notifies the owner that the node has left the list. The owner may free the node from here
    /// on.
    fn leave(&self, how: Left) {
        if let Left::Closed = how {
            self.is_closed.store(true, Ordering::Relaxed);
        }
        self.is_fired.store(true, Ordering::Release);
    }

    /// Whether it has left, and why. Acquire.
    fn woken(&self) -> Option<Woken> {
        self.is_fired.load(Ordering::Acquire).then(|| {
            match self.is_closed.load(Ordering::Relaxed) {
                true => Woken::ByEnd,
                false => Woken::ByTick,
            }
        })
    }
}

/// Waits for a tick: made by [`TickList::wait`].
///
/// # Invariants
///
/// `node` is in `list` exactly while `is_listed` and not `is_fired`; then the wait is pinned, and
/// the list's lock guards the node except for its atomics.
pub struct TickWait<'a> {
    list: &'a TickList,
    is_listed: bool,
    node: UnsafeCell<Node>,
    _pinned: PhantomPinned,
}

// SAFETY: a listed node is accessed under the list's lock alone, on any thread; its flags are
// atomic.
unsafe impl Send for TickWait<'_> {}
// SAFETY: `&TickWait` gives access to nothing but the flags.
unsafe impl Sync for TickWait<'_> {}

impl TickWait<'_> {
    fn node(&self) -> NonNull<WaitNode> {
        NonNull::new(self.node.get())
            .expect("a cell's address is never null")
            .cast()
    }

    fn woken(&self) -> Option<Woken> {
        // SAFETY: the flags are atomics, which any thread may read; the other fields are not
        // accessed.
        unsafe { (*self.node.get()).woken() }
    }
}

impl Future for TickWait<'_> {
    type Output = Woken;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Woken> {
        // SAFETY: nothing is moved out of the pinned wait.
        let this = unsafe { self.get_unchecked_mut() };
        if this.is_listed {
            if let Some(woken) = this.woken() {
                this.is_listed = false;
                return Poll::Ready(woken);
            }
            let mut renewal = Renewal::of(cx);
            let woken = renewal.put(|renewal| {
                let _waiting = this.list.waiting.lock();
                let woken = this.woken();
                if woken.is_none() {
                    // SAFETY: the lock that guards the node is held, and it is in the list.
                    renewal.store(unsafe { (*this.node().as_ptr()).wakeup_mut() });
                }
                woken
            });
            // Fired just now: its wake is pending, and will be spurious.
            return woken.map_or(Poll::Pending, |woken| {
                this.is_listed = false;
                Poll::Ready(woken)
            });
        }
        if !current::count_operation() {
            // The budget of operations that did not have to wait is used up: the next poll starts a
            // new count.
            current::ready_again(cx, current::Place::Last);
            return Poll::Pending;
        }
        let wakeup = WakeHandle::of(cx);
        let mut waiting = this.list.waiting.lock();
        // SAFETY: the node is in no list, so only this wait uses it.
        let at = unsafe { (*this.node.get()).at };
        if waiting.fired_until >= at || waiting.is_closed {
            let woken = match waiting.fired_until >= at {
                true => Woken::ByTick,
                false => Woken::ByEnd,
            };
            return Poll::Ready(woken);
        }
        // SAFETY: the node is in no list; it is pinned, and leaves the list before it is freed.
        unsafe {
            let node = this.node();
            waiting.list.insert(node, current::priority(), wakeup);
        }
        this.is_listed = true;
        Poll::Pending
    }
}

impl Drop for TickWait<'_> {
    fn drop(&mut self) {
        if !self.is_listed {
            return;
        }
        let mut waiting = self.list.waiting.lock();
        if self.woken().is_none() {
            // SAFETY: the lock is held, and a node that was listed and has not left is in the list.
            let former = unsafe { waiting.take_off(self.node()) };
            drop(waiting);
            drop(former);
        }
    }
}

impl fmt::Debug for TickWait<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TickWait")
            .field("is_listed", &self.is_listed)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests;
