//! The deadline queue of a thread: of an executor, or of the timer manager, whose queue is
//! [shared](TimerQueue::shared): other threads arm in it too.
//!
//! The thread sleeps until [`TimerQueue::next_deadline`], then calls [`TimerQueue::expire`]. The
//! nodes lie in the waiting futures: arming, expiring and cancelling allocate nothing and take
//! O(log n) steps. A thread that does not check its queue before each poll is called
//! ([`DeadlineListener`]) when a deadline is armed that is earlier than all that the thread
//! provides for.

mod heap;
mod shared;

use alloc::format;
use alloc::string::String;
pub use shared::{Deadline, Due};

use crate::biased_lock::BiasedLock;
use crate::current::{self, PendingWake, Priority, Renewal, WakeHandle};
use crate::events;
use core::cell::UnsafeCell;
use core::future::Future;
use core::marker::PhantomPinned;
use core::mem::MaybeUninit;
use core::panic::Location;
use core::pin::Pin;
use core::ptr::NonNull;
use core::task::{Context, Poll};
use core::time::Duration;
use heap::{Heap, Label, Node};
use luna_platform::clock::Instant;
use luna_platform::sync::Arc;
use luna_platform::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The armed deadlines of one thread.
///
/// Its thread alone expires, and arms unless the queue is shared. A sleep that is dropped on
/// another thread cancels itself from there, hence the lock; as long as none is, the lock is biased
/// to the thread's executor.
pub struct TimerQueue {
    heap: BiasedLock<Heap>,
    /// Any thread arms in it.
    is_shared: bool,
    /// No deadline is armed any more. Written under the lock.
    is_closed: AtomicBool,
    /// The earliest armed deadline or an earlier one, as nanoseconds: read by the owner without the
    /// lock.
    next: AtomicU64,
    /// The owner checks the queue in time for deadlines from this one on, as nanoseconds. Only the
    /// owner's thread reads and writes it; in a shared queue, the thread that holds the lock.
    provided: AtomicU64,
    listener: Option<alloc::sync::Arc<dyn DeadlineListener>>,
}

/// Notifications of a [`TimerQueue`] to its owner.
pub trait DeadlineListener: Send + Sync {
    /// The owner has to check its queue before it polls the next process. Called on its own thread,
    /// in the middle of a poll.
    fn ask_look(&self);

    /// The owner has to check its queue at `deadline`, for which it does not provide yet. Called
    /// under the queue's lock if that is shared, by any thread, and by the owner for what comes
    /// next.
    fn ask_look_at(&self, deadline: Instant) {
        let _ = deadline;
        self.ask_look();
    }
}

impl TimerQueue {
    /// An empty queue; its owner checks it before each poll.
    pub fn new() -> Self {
        Self::provided_from(Instant::from_nanos(0), None, false)
    }

    /// An empty queue; its owner checks it when notified: for each deadline, until the owner has
    /// [provided](Self::provide) for some.
    pub fn attended(listener: alloc::sync::Arc<dyn DeadlineListener>) -> Self {
        Self::provided_from(Instant::NEVER, Some(listener), false)
    }

    fn provided_from(
        deadline: Instant,
        listener: Option<alloc::sync::Arc<dyn DeadlineListener>>,
        is_shared: bool,
    ) -> Self {
        Self {
            heap: BiasedLock::new(Heap::new()),
            is_shared,
            is_closed: AtomicBool::new(false),
            next: AtomicU64::new(u64::MAX),
            provided: AtomicU64::new(deadline.as_nanos()),
            listener,
        }
    }

    /// States that the owner checks the queue in time for deadlines at `deadline` and later: it is
    /// notified of earlier ones alone. On the owner's thread.
    pub fn provide(&self, deadline: Instant) {
        self.provided.store(deadline.as_nanos(), Ordering::Relaxed);
    }

    /// The deadline that the owner provides for; or an earlier one of which it was notified since.
    /// On the owner's thread. O(1), one load.
    pub fn provided(&self) -> Instant {
        Instant::from_nanos(self.provided.load(Ordering::Relaxed))
    }

    /// Makes the owner check the queue before its next poll, if it does not before each one. On the
    /// owner's thread.
    pub fn ask_look(&self) {
        if self.provided().as_nanos() > 0
            && let Some(listener) = &self.listener
        {
            listener.ask_look();
        }
    }

    /// Notifies the owner of an armed deadline that is earlier than all that it provides for.
    #[inline]
    fn announce(&self, deadline: Instant) {
        if deadline < self.provided() {
            self.provide(deadline);
            self.ask_look_at(deadline);
        }
    }

    #[cold]
    fn ask_look_at(&self, deadline: Instant) {
        if let Some(listener) = &self.listener {
            listener.ask_look_at(deadline);
        }
    }

    /// When to call [`expire`](Self::expire): [`Instant::NEVER`] if nothing is armed. O(1), one
    /// load.
    #[inline]
    pub fn next_deadline(&self) -> Instant {
        Instant::from_nanos(self.next.load(Ordering::Relaxed))
    }

    /// Readies all waiters with a deadline at `now` or before, in the order of their deadlines. O(k
    /// log n) for k of them.
    pub fn expire(&self, now: Instant) {
        while self.next_deadline() <= now {
            let ready = {
                let mut heap = self.heap.lock();
                if heap.first_deadline().is_none_or(|first| first > now) {
                    self.publish_next(&heap);
                    return;
                }
                self.fire(&mut heap)
            };
            // The last step of this deadline. A foreign waker that panics here ends the executor,
            // which is an emergency: otherwise a process that is never woken would wait without a
            // report.
            ready.wake();
        }
    }

    /// Removes the first node of this queue's `heap`, and returns the wake of its process.
    #[inline(always)]
    fn fire(&self, heap: &mut Heap) -> PendingWake {
        let wake_handle = heap.pop().and_then(|(wake_handle, ..)| wake_handle);
        self.publish_next(heap);
        wake_handle.map_or(PendingWake::NONE, WakeHandle::take)
    }

    /// Removes a node that has not fired, and gives its wake handle.
    ///
    /// # Safety
    ///
    /// As for [`Heap::withdraw`], of this queue's heap: `node` was inserted there, was not
    /// withdrawn since, and is live.
    #[inline(always)]
    unsafe fn withdraw(&self, node: NonNull<Node>) -> Option<Option<WakeHandle>> {
        let mut heap = self.heap.lock();
        // SAFETY: the caller promises that the node was inserted into this heap, was not withdrawn
        // since, and is live; the lock that guards the nodes is held.
        let withdrawn = unsafe { heap.withdraw(node) }?;
        self.publish_next(&heap);
        Some(withdrawn)
    }

    /// Adds a deadline, with a wait of the current process or with a number, and notifies the owner
    /// if it has to be. Returns whether it did: not if the queue is closed.
    ///
    /// # Safety
    ///
    /// As for [`Heap::insert`]: `node` is room for a node, and none in a heap; it stays where it
    /// is, and the node is removed before it is freed.
    #[inline]
    unsafe fn arm(
        &self,
        node: NonNull<Node>,
        deadline: Instant,
        wake_handle: Option<WakeHandle>,
        number: u32,
    ) -> bool {
        // The owner of its own deadlines wakes them as they come, whatever their priority.
        let priority = match self.is_shared && wake_handle.is_some() {
            true => current::priority(),
            false => Priority::default(),
        };
        let mut heap = self.heap.lock();
        if self.is_closed() {
            drop(heap);
            // User code, behind the lock.
            drop(wake_handle);
            return false;
        }
        // SAFETY: the caller promises what `insert` requires: `node` is room for a node that is in
        // no heap; it stays where it is, and the node is removed before it is freed.
        unsafe { heap.insert(node, deadline, wake_handle, Label { number, priority }) };
        self.publish_next(&heap);
        // Under the lock, so that of two threads the one with the earlier deadline comes last.
        self.announce(deadline);
        true
    }

    /// Whether it belongs to another thread than the calling one, whose deadlines are its own.
    #[inline]
    fn is_left_here(queue: &Arc<Self>) -> bool {
        !queue.is_shared && current::has_other_timers(queue)
    }

    fn publish_next(&self, heap: &Heap) {
        let next = heap.first_deadline().unwrap_or(Instant::NEVER);
        self.next.store(next.as_nanos(), Ordering::Relaxed);
    }
}

/// Waits until an instant. Made by [`Sleep::until`].
///
/// Real-time path: yes; O(log n) for n sleeps of this thread, no allocation, no system call of its
/// own. Cancel-safe: dropping it cancels it.
///
/// # Panics
///
/// Panics when polled for the first time on a thread that runs no LUNA process: there is no timer
/// queue. Under another runtime use that runtime's timers.
///
/// # Invariants
///
/// While `armed`, the sleep is pinned, and there is a node. It is in `queue`'s heap until it has
/// fired, and the heap's lock guards it except for `fired`. A node that is in no heap has no wake
/// handle, so nothing of it is to be dropped.
#[derive(Debug)]
pub struct Sleep {
    /// While it `is_relative`, as a span of time from the beginning of the clock.
    deadline: Instant,
    is_relative: bool,
    armed: bool,
    queue: Option<Arc<TimerQueue>>,
    node: UnsafeCell<MaybeUninit<Node>>,
    _pinned: PhantomPinned,
}

/// What was found of a sleep that is armed.
enum Armed {
    Is(Poll<()>),
    /// It was, on another thread, and is to be armed anew. The wake handle is not needed any more.
    NotHere(Option<WakeHandle>),
}

// SAFETY: a node in a heap is accessed under the heap's lock alone, on any thread; `fired` is
// atomic.
unsafe impl Send for Sleep {}
// SAFETY: `&Sleep` gives access to the deadline only.
unsafe impl Sync for Sleep {}

impl Sleep {
    /// Waits until `deadline`; an instant in the past is ready at once.
    #[inline]
    pub fn until(deadline: Instant) -> Self {
        Self::new(deadline, false)
    }

    /// Waits for `time` from its first poll on. Making one does not read the clock.
    #[inline]
    pub fn after(time: Duration) -> Self {
        Self::new(Instant::from_nanos(0) + time, true)
    }

    /// As [`until`](Self::until), but by the owner of a shared `queue`. It ends early when the
    /// queue is [closed](TimerQueue::close).
    pub fn by(queue: &Arc<TimerQueue>, deadline: Instant) -> Self {
        let mut sleep = Self::until(deadline);
        sleep.queue = Some(queue.clone());
        sleep
    }

    #[inline]
    fn new(deadline: Instant, is_relative: bool) -> Self {
        Self {
            deadline,
            is_relative,
            armed: false,
            queue: None,
            node: UnsafeCell::new(MaybeUninit::uninit()),
            _pinned: PhantomPinned,
        }
    }

    fn node(&self) -> NonNull<Node> {
        NonNull::from(&self.node).cast()
    }

    /// The instant it waits for. [`Instant::NEVER`] before the first poll, if it is counted from
    /// there.
    pub fn deadline(&self) -> Instant {
        match self.is_relative {
            true => Instant::NEVER,
            false => self.deadline,
        }
    }

    /// Whether its instant has come. O(1), one clock read.
    pub fn has_come(&self) -> bool {
        Instant::now() >= self.deadline()
    }

    /// Waits for another instant from now on, as if it were made anew. O(log n).
    pub fn reset(self: Pin<&mut Self>, deadline: Instant) {
        let this = self.in_place();
        let _former = this.disarm();
        this.deadline = deadline;
        this.is_relative = false;
    }

    /// Its fields, of which no code here moves the node.
    #[inline(always)]
    fn in_place(self: Pin<&mut Self>) -> &mut Self {
        // SAFETY: what is pinned is the node, which every method leaves where it is.
        unsafe { self.get_unchecked_mut() }
    }

    /// Polls one that was armed.
    fn poll_armed(&mut self, cx: &Context<'_>) -> Armed {
        let node = self.node();
        // SAFETY: it was armed, so there is a node.
        if unsafe { Heap::has_fired(node) } {
            self.armed = false;
            self.deadline = Instant::from_nanos(0);
            return Armed::Is(Poll::Ready(()));
        }
        let Some(queue) = &self.queue else {
            return Armed::Is(Poll::Pending);
        };
        if TimerQueue::is_left_here(queue) {
            // A deadline belongs to the thread that polls it: the thread of the other queue may
            // have ended.
            return Armed::NotHere(self.disarm());
        }
        let mut renewal = Renewal::of(cx);
        renewal.put(|renewal| {
            // SAFETY: it was armed in this queue.
            unsafe { queue.heap.lock().renew(node, renewal) };
        });
        events::waits_for_other();
        Armed::Is(Poll::Pending)
    }

    /// Before it goes.
    #[inline(never)]
    fn cancel(&mut self) {
        let _former = self.disarm();
        if let Some(queue) = self.queue.take() {
            current::give_back_timers(queue);
        }
    }

    /// Returns its wake handle, if there is one.
    #[must_use = "its drop is user code, and the caller's last step"]
    fn disarm(&mut self) -> Option<WakeHandle> {
        if !core::mem::take(&mut self.armed) {
            return None;
        }
        events::waits_no_more(|| None);
        // SAFETY: it was armed in this queue, and is disarmed once.
        unsafe { self.queue.as_ref()?.withdraw(self.node()) }.flatten()
    }
}

/// Panics: `what` was awaited where there are no timers. `made_at` is the line that made it, if
/// that is known.
#[cold]
#[inline(never)]
pub fn no_timers(what: &str, made_at: Option<&Location<'_>>) -> ! {
    let line = made_at.map_or_else(String::new, |line| format!(", made at {line},"));
    panic!(
        "{what}{line} was awaited on a thread that runs no LUNA process: await it inside \
         luna::run, a process of a System, or use your runtime's timers"
    );
}

impl Future for Sleep {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        self.poll_or(cx, || {
            no_timers("an operation with a timeout or a deadline", None)
        })
    }
}

impl Sleep {
    /// Polls it. Where this thread has no timers, `refuse` panics in the words of the operation
    /// that this sleep is a part of: see [`no_timers`].
    #[inline]
    pub fn poll_or(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        refuse: impl FnOnce() -> Arc<TimerQueue>,
    ) -> Poll<()> {
        let this = self.in_place();
        let mut _former = None;
        if this.armed {
            match this.poll_armed(cx) {
                Armed::Is(polled) => return polled,
                Armed::NotHere(former) => _former = former,
            }
        }
        let now = Instant::now();
        if core::mem::take(&mut this.is_relative) {
            this.deadline = now.plus_nanos(this.deadline.as_nanos());
        }
        if now >= this.deadline {
            if !current::count_operation() {
                // The budget of operations that did not have to wait is used up: the next poll
                // starts a new count.
                current::ready_again(cx, current::QueueEnd::Back);
                return Poll::Pending;
            }
            return Poll::Ready(());
        }
        if this.queue.as_ref().is_none_or(TimerQueue::is_left_here) {
            this.queue = Some(current::timers().unwrap_or_else(refuse));
        }
        if let Some(queue) = &this.queue {
            let wake_handle = WakeHandle::of(cx);
            // SAFETY: there is no node in a heap, so only this sleep uses the room for it; it is
            // pinned, and the node leaves the heap before it is freed.
            this.armed = unsafe { queue.arm(this.node(), this.deadline, Some(wake_handle), 0) };
            if !this.armed {
                return Poll::Ready(());
            }
        }
        events::waits_for_other();
        Poll::Pending
    }
}

impl Drop for Sleep {
    #[inline]
    fn drop(&mut self) {
        if self.queue.is_some() {
            self.cancel();
        }
    }
}

luna_platform::debug_fields!(TimerQueue, |queue| next_deadline: queue.next_deadline());

#[cfg(all(test, not(loom)))]
mod tests;
