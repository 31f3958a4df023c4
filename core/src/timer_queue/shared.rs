//! A queue in which any thread arms, and whose owner wakes what is due in order of priority.

use super::heap::Heap;
use super::{Arc, DeadlineListener, Ordering, Sleep, TimerQueue};
use crate::current::{PendingWake, Priority};
use alloc::boxed::Box;
use alloc::vec::Vec;
use core::pin::Pin;
use luna_platform::clock::Instant;

/// What is due, to be woken or called when no lock is held.
#[derive(Debug)]
pub struct Due {
    who: Vec<(Priority, usize, PendingWake)>,
    /// The numbers of the [`Deadline`]s, in their order.
    pub calls: Vec<u32>,
    /// The longest time from the deadline of a wait until it was taken, in nanoseconds.
    pub latest: u64,
}

impl Due {
    /// Room for so many wakes and calls at a time, at least one. Allocates.
    pub fn with_room_for(wakes: usize, calls: usize) -> Self {
        Self {
            who: Vec::with_capacity(wakes.max(1)),
            calls: Vec::with_capacity(calls.max(1)),
            latest: 0,
        }
    }

    fn is_full(&self) -> bool {
        self.who.len() == self.who.capacity() || self.calls.len() == self.calls.capacity()
    }

    /// Wakes all in order of priority, and in the order of deadlines within one priority. Returns
    /// their number. O(n log n).
    pub fn wake(&mut self) -> usize {
        // Unstable: the stable sort allocates.
        self.who
            .sort_unstable_by_key(|&(priority, number, _)| (core::cmp::Reverse(priority), number));
        let number = self.who.len();
        for (_, _, ready) in self.who.drain(..) {
            ready.wake_contained();
        }
        number
    }
}

impl TimerQueue {
    /// An empty queue in which any thread arms. Its owner is notified of each deadline that it has
    /// to provide for ([`DeadlineListener::ask_look_at`]), until the next
    /// [`take_due`](Self::take_due).
    pub fn shared(listener: alloc::sync::Arc<dyn DeadlineListener>) -> Self {
        Self::provided_from(Instant::NEVER, Some(listener), true)
    }

    /// Takes out all with a deadline at `now` or before, and adds them to `due`. `false` if `due`
    /// has no room for all: deal with it and call again. The owner is notified of nothing until it
    /// [settles](Self::settle). O(k log n) for k of them.
    pub fn take_due(&self, now: Instant, due: &mut Due) -> bool {
        let mut heap = self.heap.lock();
        self.provide(Instant::from_nanos(0));
        let is_due = |heap: &Heap| heap.first_deadline().is_some_and(|first| first <= now);
        while is_due(&heap) && !due.is_full() {
            match heap.pop() {
                Some((Some(wake_handle), deadline, label)) => {
                    due.latest = due.latest.max(now.nanos_since(deadline));
                    let number = due.who.len();
                    due.who.push((label.priority, number, wake_handle.take()));
                }
                Some((None, _, label)) => due.calls.push(label.number),
                None => break,
            }
        }
        self.publish_next(&heap);
        !is_due(&heap)
    }

    /// The owner goes to sleep: it is notified of the next deadline, and of each earlier one from
    /// now on.
    pub fn settle(&self) {
        let _heap = self.heap.lock();
        let next = self.next_deadline();
        self.provide(next);
        if next != Instant::NEVER {
            self.ask_look_at(next);
        }
    }

    /// The owner is to look now, and is notified of nothing more.
    pub fn ask_look_now(&self) {
        let _heap = self.heap.lock();
        self.provide(Instant::from_nanos(0));
        self.ask_look_at(Instant::from_nanos(0));
    }

    /// Ends all waits, and each that begins later: the queue has no owner any more. Not for the
    /// real-time path.
    pub fn close(&self) {
        loop {
            let mut heap = self.heap.lock();
            self.is_closed.store(true, Ordering::Release);
            if heap.first_deadline().is_none() {
                return;
            }
            let ready = self.fire(&mut heap);
            drop(heap);
            ready.wake_contained();
        }
    }

    /// Whether it is [closed](Self::close).
    pub fn is_closed(&self) -> bool {
        self.is_closed.load(Ordering::Acquire)
    }
}

/// A deadline without a wait, in a shared queue: its owner gets its number.
///
/// # Invariants
///
/// The sleep has its queue while it is armed, and no other time. Its node has no wake handle.
#[derive(Debug)]
pub struct Deadline(Pin<Box<Sleep>>);

impl Deadline {
    /// A deadline that is not armed. Allocates.
    pub fn new() -> Self {
        Self(Box::pin(Sleep::until(Instant::NEVER)))
    }

    /// Arms it for `at`, which may have passed, in place of a former instant; the owner knows it by
    /// `number`. Nothing in a queue that is closed. O(log n), no allocation; at most one system
    /// call of the owner's.
    pub fn arm(&mut self, queue: &Arc<TimerQueue>, number: u32, at: Instant) {
        self.disarm();
        let sleep = self.0.as_mut().in_place();
        // SAFETY: no node is in a heap by `disarm`; the sleep is pinned, and the node leaves the
        // heap before it is freed.
        sleep.armed = unsafe { queue.arm(sleep.node(), at, None, number) };
        sleep.queue = sleep.armed.then(|| queue.clone());
    }

    /// Disarms it; returns whether it was armed, and has not been taken as due. O(log n).
    pub fn disarm(&mut self) -> bool {
        let sleep = self.0.as_mut().in_place();
        sleep.armed = false;
        let Some(queue) = sleep.queue.take() else {
            return false;
        };
        // SAFETY: the queue was there, so by the invariant there is a node, which was armed in it.
        unsafe { queue.withdraw(sleep.node()) }.is_some()
    }

    /// Whether it was taken as due since it was armed; asked once.
    pub fn take_fired(&mut self) -> bool {
        let sleep = self.0.as_mut().in_place();
        // SAFETY: the queue is there, so by the invariant there is a node.
        let has_fired = sleep.queue.is_some() && unsafe { Heap::has_fired(sleep.node()) };
        if has_fired {
            sleep.armed = false;
            sleep.queue = None;
        }
        has_fired
    }
}

impl Drop for Deadline {
    fn drop(&mut self) {
        self.disarm();
    }
}

#[cfg(test)]
mod tests;
