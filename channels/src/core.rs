//! The channel itself: what both ends share, and the steps of the protocol that happen under its lock.
//!
//! Whoever arrives second does the work: it takes the partner off the waiting list, moves the value, settles the partner's
//! outcome, releases the lock, and readies the partner, in this order. Settling the outcome gives the partner's node up: its
//! future may be polled and dropped at that very moment on another core, so nothing of it is touched afterwards (invariant 3
//! of the protocol), and whom to wake was taken out before.
//!
//! ```text
//!   node:   idle --list--> WAITING --partner, under the lock--> DONE | CLOSED | POISONED
//!                             |
//!                             '-- withdrawn by its own future, under the lock --> idle
//! ```

use crate::buffer::{Buffer, WhenFull};
use crate::waiter::{Outcome, Waiter};
use luna_platform::current::{Priority, Ready, Wakeup};
use luna_platform::lock::{PiGuard, PiLock};
use luna_platform::reclaim::{self, Retired};
use luna_platform::sync::atomic::{AtomicUsize, Ordering};
use luna_platform::wait_list::WaitList;
use std::collections::VecDeque;
use std::ptr::NonNull;

/// How many received values can come back from dropped futures before room for more must be made: see [`Channel::give_back`].
const SPARE: usize = 2;

/// Whether more can be communicated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ending {
    Open,
    /// All senders are gone, or all receivers.
    Closed,
    Poisoned,
}

/// What the lock guards.
pub(crate) struct State<T> {
    senders: WaitList,
    receivers: WaitList,
    /// Buffered values, and before them those that came back from futures dropped after their receive.
    store: VecDeque<T>,
    ending: Ending,
}

/// What both kinds of ends share.
#[repr(C)]
pub(crate) struct Channel<T> {
    /// First, so that it leads back to this.
    retired: Retired,
    senders: AtomicUsize,
    receivers: AtomicUsize,
    /// 2 kinds of ends, 1, then the channel goes.
    kinds: AtomicUsize,
    buffer: Buffer,
    state: PiLock<State<T>>,
}

/// A send under the lock came to this.
pub(crate) enum Sent<T> {
    /// A receiver has it, or the buffer. Ready the receiver; drop what was overwritten.
    Done(Ready, Option<T>),
    /// Nobody takes it now.
    Full(T),
    /// Nobody will ever take it.
    Ended(T, Ending),
}

/// A receive under the lock came to this.
pub(crate) enum Received<T> {
    Done(T, Ready),
    Empty,
    Ended(Ending),
}

impl<T> Channel<T> {
    /// A new channel on the heap, with one end of each kind.
    pub(crate) fn allocate(buffer: Buffer) -> NonNull<Channel<T>> {
        let channel = Box::new(Channel {
            retired: Retired::new(Self::free),
            senders: AtomicUsize::new(1),
            receivers: AtomicUsize::new(1),
            kinds: AtomicUsize::new(2),
            buffer,
            state: PiLock::new(State {
                senders: WaitList::new(),
                receivers: WaitList::new(),
                store: VecDeque::with_capacity(buffer.capacity.saturating_add(SPARE)),
                ending: Ending::Open,
            }),
        });
        NonNull::from(Box::leak(channel))
    }

    unsafe fn free(head: NonNull<Retired>) {
        // SAFETY: `allocate` made it of a box, and the head is the channel's first field.
        drop(unsafe { Box::from_raw(head.cast::<Channel<T>>().as_ptr()) });
    }

    #[inline]
    pub(crate) fn lock(&self) -> PiGuard<'_, State<T>> {
        self.state.lock()
    }

    /// Sends at once, if that can be. O(1).
    #[inline]
    pub(crate) fn send_now(&self, state: &mut State<T>, value: T) -> Sent<T> {
        if state.ending != Ending::Open {
            return Sent::Ended(value, state.ending);
        }
        if let Some(receiver) = state.receivers.pop() {
            let receiver = receiver.cast::<Waiter<T>>();
            // SAFETY: a listed node is a live waiter that the lock guards; a receiver's holds no value before it is done.
            let ready = unsafe {
                receiver.as_ref().put_value(value);
                Waiter::settle(receiver, Outcome::Done)
            };
            return Sent::Done(ready, None);
        }
        if state.store.len() < self.buffer.capacity {
            state.store.push_back(value);
            return Sent::Done(Ready::NOBODY, None);
        }
        match self.buffer.when_full {
            WhenFull::Wait => Sent::Full(value),
            WhenFull::DropOldest => {
                let dropped = state.store.pop_front();
                state.store.push_back(value);
                Sent::Done(Ready::NOBODY, dropped)
            }
            WhenFull::DropNewest => {
                let dropped = state.store.pop_back();
                state.store.push_back(value);
                Sent::Done(Ready::NOBODY, dropped)
            }
        }
    }

    /// Receives at once, if that can be. O(1).
    #[inline]
    pub(crate) fn recv_now(&self, state: &mut State<T>) -> Received<T> {
        if state.ending == Ending::Poisoned {
            return Received::Ended(Ending::Poisoned);
        }
        if let Some(value) = state.store.pop_front() {
            // A sender that waited for room moves up.
            let ready = if state.store.len() < self.buffer.capacity
                && let Some((next, ready)) = Self::take_waiting_sender(state)
            {
                state.store.push_back(next);
                ready
            } else {
                Ready::NOBODY
            };
            return Received::Done(value, ready);
        }
        match Self::take_waiting_sender(state) {
            Some((value, ready)) => Received::Done(value, ready),
            None if state.ending == Ending::Closed => Received::Ended(Ending::Closed),
            None => Received::Empty,
        }
    }

    #[inline]
    fn take_waiting_sender(state: &mut State<T>) -> Option<(T, Ready)> {
        let sender = state.senders.pop()?.cast::<Waiter<T>>();
        // SAFETY: a listed node is a live waiter that the lock guards; a sender's holds its value until it is done.
        unsafe {
            let value = sender.as_ref().take_value();
            Some((value, Waiter::settle(sender, Outcome::Done)))
        }
    }

    /// Lets a sender wait. O(1), or O(waiting senders of lower priority).
    ///
    /// # Safety
    ///
    /// `node` is a sender's, holds its value, is not listed, and stays where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn list_sender(
        state: &mut State<T>,
        node: NonNull<Waiter<T>>,
        priority: Priority,
        wakeup: Wakeup,
    ) {
        // SAFETY: the contract; the wait node is the first field.
        unsafe { state.senders.insert(node.cast(), priority, wakeup) };
    }

    /// Lets a receiver wait. O(1), or O(waiting receivers of lower priority).
    ///
    /// # Safety
    ///
    /// `node` is a receiver's, holds no value, is not listed, and stays where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn list_receiver(
        state: &mut State<T>,
        node: NonNull<Waiter<T>>,
        priority: Priority,
        wakeup: Wakeup,
    ) {
        // SAFETY: the contract; the wait node is the first field.
        unsafe { state.receivers.insert(node.cast(), priority, wakeup) };
    }

    /// Takes a waiting operation off its list, if it has not been settled; says which.
    ///
    /// # Safety
    ///
    /// `node` was listed in this channel, on the side that `of_sender` says.
    pub(crate) unsafe fn withdraw(&self, node: NonNull<Waiter<T>>, of_sender: bool) -> Outcome {
        let mut state = self.lock();
        // SAFETY: under the lock a waiting node is listed.
        unsafe {
            let outcome = Waiter::outcome(node);
            if outcome == Outcome::Waiting {
                let list = if of_sender {
                    &mut state.senders
                } else {
                    &mut state.receivers
                };
                list.remove(node.cast());
                let unused = (*node.as_ptr()).wait.wakeup_mut().take();
                // Whatever it says but that it waits: withdrawing again, should the waker's drop panic, then does nothing.
                (*node.as_ptr())
                    .outcome
                    .store(Outcome::Closed as u8, Ordering::Relaxed);
                // Dropping a waker can run anything, so not under the lock.
                drop(state);
                drop(unused);
            }
            outcome
        }
    }

    /// Sees to it that a waiting operation wakes who polled it last.
    ///
    /// # Safety
    ///
    /// `node` was listed in this channel and was not withdrawn.
    pub(crate) unsafe fn update_wakeup(
        &self,
        node: NonNull<Waiter<T>>,
        cx: &std::task::Context<'_>,
    ) -> Outcome {
        let state = self.lock();
        // SAFETY: under the lock a waiting node may be changed.
        unsafe {
            let outcome = Waiter::outcome(node);
            if outcome == Outcome::Waiting {
                let wakeup = (*node.as_ptr()).wait.wakeup_mut();
                if !wakeup.as_ref().is_some_and(|wakeup| wakeup.is_of(cx)) {
                    let unused = wakeup.replace(Wakeup::of(cx));
                    // Dropping a waker can run anything, so not under the lock.
                    drop(state);
                    drop(unused);
                }
            }
            outcome
        }
    }

    /// Takes back a value that was received by a future which was dropped before it could hand it on: the value goes to the next
    /// receiver, before all others; nobody receives it from a poisoned channel, where it is dropped. An overwriting buffer that has become
    /// full in the meantime drops what it would have dropped had the value never left. Allocates only if more than [`SPARE`] values, or
    /// one for each receiver, are back at once.
    pub(crate) fn give_back(&self, value: T) {
        let (ready, overwritten) = {
            let mut state = self.lock();
            if state.ending == Ending::Poisoned {
                drop(state);
                drop(value);
                return;
            }
            match state.receivers.pop() {
                Some(receiver) => {
                    let receiver = receiver.cast::<Waiter<T>>();
                    // SAFETY: as in `send_now`.
                    let ready = unsafe {
                        receiver.as_ref().put_value(value);
                        Waiter::settle(receiver, Outcome::Done)
                    };
                    (ready, None)
                }
                None => {
                    state.store.push_front(value);
                    let length = state.store.len();
                    let overwritten = match self.buffer.when_full {
                        WhenFull::DropOldest if length > self.buffer.capacity => {
                            state.store.pop_front()
                        }
                        // The newest stays, which has replaced the one before it.
                        WhenFull::DropNewest if length > self.buffer.capacity => {
                            state.store.remove(length - 2)
                        }
                        _ => None,
                    };
                    (Ready::NOBODY, overwritten)
                }
            }
        };
        ready.wake();
        // The user's code, so not under the lock.
        drop(overwritten);
    }

    /// Poisons the channel: all who wait and all who come fail. O(those who wait + what is stored), one lock section each.
    pub(crate) fn poison(&self) {
        self.end(Ending::Poisoned);
        self.drop_stored();
    }

    /// Drops what nobody will receive. At once and not with the channel, since a value may be what somebody waits for (the way back to a
    /// client, say), and may borrow what the channel's memory outlives until it is reclaimed.
    ///
    /// To be called when the channel has ended for receivers: nothing is stored after that.
    fn drop_stored(&self) {
        // One by one, and not under the lock: the drop of a value can run anything.
        loop {
            let value = self.lock().store.pop_front();
            if value.is_none() {
                return;
            }
        }
    }

    fn end(&self, ending: Ending) {
        let mut state = self.lock();
        if state.ending == Ending::Poisoned {
            return;
        }
        state.ending = ending;
        let outcome = match ending {
            Ending::Poisoned => Outcome::Poisoned,
            _ => Outcome::Closed,
        };
        // Who comes from now on sees the ending, so the lists only get shorter. One by one, so that the lock is held for few steps.
        while let Some(node) = state.senders.pop().or_else(|| state.receivers.pop()) {
            // SAFETY: the node was listed, and the lock is held. A sender keeps its value, a receiver has none.
            let ready = unsafe { Waiter::<T>::settle(node.cast(), outcome) };
            drop(state);
            ready.wake();
            state = self.lock();
        }
    }

    pub(crate) fn add_sender(&self) {
        self.senders.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn add_receiver(&self) {
        let receivers = self.receivers.fetch_add(1, Ordering::Relaxed) + 1;
        if receivers > SPARE {
            // Each receiver may have one receive under way that gives its value back.
            let mut state = self.lock();
            let needed = self
                .buffer
                .capacity
                .saturating_add(receivers)
                .saturating_sub(state.store.len());
            state.store.reserve(needed);
        }
    }

    /// # Safety
    ///
    /// The caller gives up a sender, which it does not use again.
    pub(crate) unsafe fn drop_sender(channel: NonNull<Self>) {
        // SAFETY: the sender kept the channel alive until now, and its kind does until `drop_kind`.
        unsafe {
            if channel.as_ref().senders.fetch_sub(1, Ordering::AcqRel) == 1 {
                channel.as_ref().end(Ending::Closed);
                Self::drop_kind(channel);
            }
        }
    }

    /// # Safety
    ///
    /// The caller gives up a receiver, which it does not use again.
    pub(crate) unsafe fn drop_receiver(channel: NonNull<Self>) {
        // SAFETY: as for `drop_sender`.
        unsafe {
            if channel.as_ref().receivers.fetch_sub(1, Ordering::AcqRel) == 1 {
                channel.as_ref().end(Ending::Closed);
                channel.as_ref().drop_stored();
                Self::drop_kind(channel);
            }
        }
    }

    unsafe fn drop_kind(channel: NonNull<Self>) {
        // SAFETY: the last one to get here is the last user; what it frees may be freed on any thread, since the values are `Send`.
        unsafe {
            if channel.as_ref().kinds.fetch_sub(1, Ordering::AcqRel) == 1 {
                reclaim::retire(channel.cast());
            }
        }
    }

    /// How many values are buffered. For display: it may have changed already.
    pub(crate) fn buffered(&self) -> usize {
        self.lock().store.len()
    }
}
