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

pub use shared::{Deadline, Due};

use crate::biased_lock::BiasedLock;
use crate::current::{self, PendingWake, Renewal, WakeHandle};
use crate::events;
use heap::{Heap, Label, Node};
use luna_platform::clock::Instant;
use luna_platform::sync::Arc;
use luna_platform::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::cell::UnsafeCell;
use std::fmt;
use std::future::Future;
use std::marker::PhantomPinned;
use std::mem::MaybeUninit;
use std::panic::Location;
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll};
use std::time::Duration;

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
    listener: Option<std::sync::Arc<dyn DeadlineListener>>,
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
    pub fn attended(listener: std::sync::Arc<dyn DeadlineListener>) -> Self {
        Self::provided_from(Instant::NEVER, Some(listener), false)
    }

    fn provided_from(
        deadline: Instant,
        listener: Option<std::sync::Arc<dyn DeadlineListener>>,
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
                let Some(first) = heap.first() else {
                    self.next.store(u64::MAX, Ordering::Relaxed);
                    return;
                };
                // SAFETY: a node in the heap is live, and the heap's lock is held.
                unsafe {
                    if (*first.as_ptr()).deadline > now {
                        self.publish_next(&heap);
                        return;
                    }
                    self.fire(&mut heap, first)
                }
            };
            // The last step of this deadline. A foreign waker that panics here ends the executor,
            // which is an emergency: otherwise a process that is never woken would wait without a
            // report.
            ready.wake();
        }
    }

    /// Removes a node, whose sleep may be freed from then on. Returns the wake of its process.
    ///
    /// # Safety
    ///
    /// `heap` is this queue's, and the node is in it.
    #[inline(always)]
    unsafe fn fire(&self, heap: &mut Heap, node: NonNull<Node>) -> PendingWake {
        // SAFETY: a node in the heap is live, and the caller holds the heap's lock.
        unsafe {
            heap.remove(node);
            self.publish_next(heap);
            let node = &mut *node.as_ptr();
            let wake_handle = node.wake_handle.take();
            node.fired.store(true, Ordering::Release);
            wake_handle.map_or(PendingWake::NONE, WakeHandle::take)
        }
    }

    /// Adds a wait, and notifies the owner, this thread, if it has to be.
    ///
    /// # Safety
    ///
    /// As for [`Heap::insert`].
    #[inline]
    unsafe fn arm(&self, node: NonNull<Node>, deadline: Instant, wake_handle: WakeHandle) {
        let mut heap = self.heap.lock();
        // SAFETY: the caller keeps the contract of `insert`.
        unsafe { heap.insert(node, deadline, Some(wake_handle), Label::default()) };
        self.publish_next(&heap);
        drop(heap);
        self.announce(deadline);
    }

    /// Whether it belongs to another thread than the calling one, whose deadlines are its own.
    #[inline]
    fn is_left_here(queue: &Arc<Self>) -> bool {
        !queue.is_shared && current::has_other_timers(queue)
    }

    fn publish_next(&self, heap: &Heap) {
        // SAFETY: the caller holds the heap's lock, and a node in it is live.
        let next = heap
            .first()
            .map_or(Instant::NEVER, |node| unsafe { node.as_ref() }.deadline);
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
    /// What the owner of a shared queue knows it by.
    number: u32,
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

    /// As [`until`](Self::until), but by the owner of a shared `queue`, which knows the wait by
    /// `number`. It ends early when the queue is [closed](TimerQueue::close).
    pub fn by(queue: &Arc<TimerQueue>, number: u32, deadline: Instant) -> Self {
        let mut sleep = Self::until(deadline);
        sleep.number = number;
        sleep.queue = Some(queue.clone());
        sleep
    }

    #[inline]
    fn new(deadline: Instant, is_relative: bool) -> Self {
        Self {
            deadline,
            is_relative,
            armed: false,
            number: 0,
            queue: None,
            node: UnsafeCell::new(MaybeUninit::uninit()),
            _pinned: PhantomPinned,
        }
    }

    fn node(&self) -> NonNull<Node> {
        // SAFETY: a cell's address is never null.
        unsafe { NonNull::new_unchecked(self.node.get()) }.cast()
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
    pub fn reset(mut self: Pin<&mut Self>, deadline: Instant) {
        let _former = self.as_mut().disarm();
        // SAFETY: nothing is moved, and a disarmed node is in no heap.
        let this = unsafe { self.get_unchecked_mut() };
        this.deadline = deadline;
        this.is_relative = false;
    }

    /// Polls one that was armed.
    fn poll_armed(mut self: Pin<&mut Self>, cx: &Context<'_>) -> Armed {
        // SAFETY: nothing is moved out.
        let this = unsafe { self.as_mut().get_unchecked_mut() };
        let node = this.node();
        // SAFETY: the node is this sleep's; `fired` is atomic, so any thread may read it.
        if unsafe { &(*node.as_ptr()).fired }.load(Ordering::Acquire) {
            this.armed = false;
            this.deadline = Instant::from_nanos(0);
            return Armed::Is(Poll::Ready(()));
        }
        let Some(queue) = &this.queue else {
            return Armed::Is(Poll::Pending);
        };
        if TimerQueue::is_left_here(queue) {
            // A deadline belongs to the thread that polls it: the thread of the other queue may
            // have ended.
            return Armed::NotHere(self.disarm());
        }
        let mut renewal = Renewal::of(cx);
        renewal.put(|renewal| {
            let _heap = queue.heap.lock();
            // SAFETY: the lock that guards the node is held.
            let wake_handle = unsafe { &mut (*node.as_ptr()).wake_handle };
            // A deadline that has just fired is ready at its next poll.
            if wake_handle.is_some() {
                renewal.store(wake_handle);
            }
        });
        events::waits_for_other();
        Armed::Is(Poll::Pending)
    }

    /// Before it goes.
    #[inline(never)]
    fn cancel(mut self: Pin<&mut Self>) {
        let _former = self.as_mut().disarm();
        // SAFETY: nothing is moved, and a disarmed node is in no heap.
        if let Some(queue) = unsafe { self.get_unchecked_mut() }.queue.take() {
            current::give_back_timers(queue);
        }
    }

    /// Returns its wake handle, if there is one.
    #[must_use = "its drop is user code, and the caller's last step"]
    fn disarm(self: Pin<&mut Self>) -> Option<WakeHandle> {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        if !this.armed {
            return None;
        }
        this.armed = false;
        events::waits_no_more(|| None);
        let queue = this.queue.as_ref()?;
        let node = this.node();
        let mut heap = queue.heap.lock();
        // SAFETY: the lock is held. `fired` under it says whether the node has left the heap; if
        // not, it is in it.
        unsafe {
            if (*node.as_ptr()).fired.load(Ordering::Relaxed) {
                return None;
            }
            heap.remove(node);
            queue.publish_next(&heap);
            (*node.as_ptr()).wake_handle.take()
        }
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
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        refuse: impl FnOnce() -> Arc<TimerQueue>,
    ) -> Poll<()> {
        let mut _former = None;
        if self.armed {
            match self.as_mut().poll_armed(cx) {
                Armed::Is(polled) => return polled,
                Armed::NotHere(former) => _former = former,
            }
        }
        // SAFETY: nothing is moved out.
        let this = unsafe { self.as_mut().get_unchecked_mut() };
        let now = Instant::now();
        if std::mem::take(&mut this.is_relative) {
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
            this.armed = unsafe {
                match queue.is_shared {
                    false => {
                        queue.arm(this.node(), this.deadline, wake_handle);
                        true
                    }
                    true => queue.arm_shared(this.node(), this.deadline, wake_handle, this.number),
                }
            };
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
            // SAFETY: a value that is being dropped does not move any more.
            unsafe { Pin::new_unchecked(self) }.cancel();
        }
    }
}

impl fmt::Debug for TimerQueue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TimerQueue")
            .field("next_deadline", &self.next_deadline())
            .finish_non_exhaustive()
    }
}

/// Defined here, so that the heap does not depend on atomics.
type Fired = AtomicBool;

#[cfg(all(test, not(loom)))]
mod tests;
