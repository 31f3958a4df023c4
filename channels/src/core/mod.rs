//! The channel itself: the state shared by both ends, and the steps of the protocol under its lock.
//!
//! The operation that arrives second does the work: it takes the partner off the waiting list,
//! moves the value, settles the partner's outcome, releases the lock, and wakes the partner, in
//! this order. Settling the outcome gives the partner's node up: its future may be polled and
//! dropped at that very moment on another core, so nothing of it is touched afterwards, and its
//! wake handle was taken out before.
//!
//! ```text
//!   node:   idle --list--> WAITING --partner, under the lock--> DONE | CLOSED | POISONED | BROKEN
//!                             |            `--> HELD --receiver is done--> DONE | ANSWERED
//!                             |                    `-- it refuses the value--> CLOSED | POISONED
//!                             |-- found by a partner, its alternative has chosen --> STALE
//!                             '-- withdrawn by its own future, under the lock --> STALE
//! ```
//!
//! A partner that finds an alternative's node commits its
//! [`SelectState`](crate::select_state::SelectState) first. If the alternative has chosen another
//! guard, the node is taken off the list and passed over: each such node costs one step, once.

mod ending;
mod hand_off;
mod locked;
mod prologue;
mod registered;

pub(crate) use hand_off::{HandOff, HandOffSlots, Nodes};
pub(crate) use locked::{Attempted, ChannelGuard, Locked};
#[cfg(all(test, loom))]
pub(crate) use prologue::taken;
pub(crate) use prologue::{FastPath, Meet, meet_alone, wake_partner};

use crate::alternative::Entry;
use crate::buffer::{Buffer, WhenFull};
use crate::finally::Finally;
use crate::inspect::{Identity, ValueMethods, WaitPointKind};
pub(crate) use crate::wait_point::Ending;
use crate::wait_point::{Lists, WaitPoint};
use crate::waiter::{Outcome, Waiter};
use alloc::boxed::Box;
use alloc::collections::VecDeque;
use core::mem::offset_of;
use core::ptr::NonNull;
use luna_core::current::{self, Here, Renewal, WakeHandle};
use luna_core::deferred_free::Retired;
use luna_platform::sync::UnsafeCell;
use luna_platform::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};

/// Number of received values that can come back from dropped futures before more memory must be
/// allocated: see [`Channel::return_value`].
const SPARE: usize = 2;

/// The state shared by both kinds of ends.
///
/// # Invariants
///
/// `store` is accessed under the lock of `wait_point` alone.
#[repr(C, align(64))]
pub(crate) struct Channel<T> {
    /// First, so that its lock lies at the beginning of a cache line.
    wait_point: WaitPoint,
    retired: Retired,
    senders: AtomicU32,
    receivers: AtomicU32,
    /// A `u32`, four bytes smaller than a `usize`. A larger number of values does not fit in
    /// memory, unless they take no room.
    capacity: u32,
    when_full: WhenFull,
    /// Number of kinds of ends that live: 2, 1, then the channel goes.
    kinds: AtomicU8,
    /// Whether alternatives that are registered here are yet to be woken. Changed under the lock.
    rings: AtomicBool,
    /// Buffered values, after values given back by futures that were dropped after their receive.
    store: UnsafeCell<VecDeque<T>>,
}

impl<T> Channel<T> {
    /// A new channel on the heap, with one end of each kind.
    pub(crate) fn allocate(buffer: Buffer, mut identity: Identity) -> NonNull<Channel<T>> {
        identity.values = const {
            &ValueMethods {
                kind: WaitPointKind::Rendezvous,
                stored: Self::stored,
                mover: Waiter::<T>::MOVER,
                store: Self::store_fast,
                take: Self::take_stored_fast,
                send_to_registered: Self::send_to_registered,
            }
        };
        let mut wait_point = WaitPoint::new(identity);
        wait_point.lock.with_mut(|lists| {
            // A buffer that drops values, or grows, needs the slow path.
            let may_be_plain = buffer.when_full == WhenFull::Wait;
            lists.set_up(
                buffer.capacity == 0,
                may_be_plain,
                Waiter::<T>::MOVER.is_none(),
            );
        });
        let channel = Box::new(Channel {
            wait_point,
            retired: Retired::new(Self::free),
            senders: AtomicU32::new(1),
            receivers: AtomicU32::new(1),
            capacity: u32::try_from(buffer.capacity).unwrap_or(u32::MAX),
            when_full: buffer.when_full,
            kinds: AtomicU8::new(2),
            rings: AtomicBool::new(false),
            store: UnsafeCell::new(VecDeque::with_capacity(
                buffer.reserved().saturating_add(SPARE),
            )),
        });
        let channel = NonNull::from(Box::leak(channel));
        // SAFETY: the channel is live, and leaves the register in `free`. Its methods are its own.
        // The pointer is made of that to the whole, so that it leads back to it.
        unsafe {
            crate::inspect::register(channel.cast());
        }
        channel
    }

    /// # Safety
    ///
    /// `head` is the `retired` of a channel that was retired, and this is called once for it.
    unsafe fn free(head: NonNull<Retired>) {
        // SAFETY: `allocate` made it of a box, and registered it; the head is a field of it.
        unsafe {
            let channel = head.byte_sub(offset_of!(Self, retired)).cast::<Self>();
            crate::inspect::unregister(&channel.as_ref().wait_point);
            drop(Box::from_raw(channel.as_ptr()));
        }
    }

    /// Number of buffered values in the channel around `wait_point`, and the capacity.
    ///
    /// # Safety
    ///
    /// `wait_point` is that of a live channel of values of this type, by a pointer to the whole,
    /// and its lock is held.
    unsafe fn stored(wait_point: NonNull<WaitPoint>) -> (usize, usize) {
        // SAFETY: `wait_point` is the first field of a live channel of values of this type, and the
        // pointer leads to the whole, as is demanded here.
        let channel = unsafe { wait_point.cast::<Channel<T>>().as_ref() };
        // SAFETY: the lock is held, as is demanded here, and guards the store.
        let now = channel.store.with(|store| unsafe { (*store).len() });
        (now, channel.capacity())
    }

    #[inline]
    fn capacity(&self) -> usize {
        self.capacity as usize
    }

    /// The stored values, and the buffer's behaviour when it is full.
    #[inline]
    fn buffer(&self) -> Buffer {
        Buffer {
            capacity: self.capacity(),
            when_full: self.when_full,
        }
    }

    #[inline]
    pub(crate) fn wait_point(&self) -> &WaitPoint {
        &self.wait_point
    }

    #[inline]
    pub(crate) fn lock(&self) -> Locked<'_, T> {
        let mut locked = self.lock_beside_slots(Here::now());
        locked.list_from_slots();
        locked
    }

    /// Locks. An operation that waits on a hand-off slot is not in the lists.
    #[inline]
    pub(crate) fn lock_beside_slots<'a>(&'a self, here: Here<'a>) -> Locked<'a, T> {
        ChannelGuard {
            channel: self,
            lists: self.wait_point.lock(here),
            here,
        }
    }

    /// The channel guard over `lists`, on the calling thread.
    ///
    /// # Safety
    ///
    /// `lists` are those of this channel.
    #[inline]
    pub(crate) unsafe fn guard_of<'a, L: Lists>(
        &'a self,
        lists: L,
        here: Here<'a>,
    ) -> ChannelGuard<'a, T, L> {
        ChannelGuard {
            channel: self,
            lists,
            here,
        }
    }

    /// Takes a waiting operation off its list, if it has not been settled; returns which. Its wake
    /// handle is to be dropped when all else is done.
    ///
    /// # Safety
    ///
    /// The caller is the future of `node`, which was listed in this channel, on the side given by
    /// `of_sender`.
    #[must_use = "the handle's drop is user code, and the caller's last step"]
    pub(crate) unsafe fn withdraw(
        &self,
        node: NonNull<Waiter<T>>,
        of_sender: bool,
    ) -> (Outcome, Option<WakeHandle>) {
        self.wait_point.waits_no_more();
        let mut locked = self.lock();
        // SAFETY: under the lock a waiting node is listed.
        unsafe {
            let outcome = Waiter::outcome(node);
            let list = match outcome {
                Outcome::Waiting => locked.lists.queue(of_sender),
                Outcome::Held => &mut locked.lists.held,
                _ => return (outcome, None),
            };
            list.remove(node.cast());
            locked.boost_while_they_wait();
            let former = (*Waiter::link(node)).wait.wake_handle_mut().take();
            let now = match outcome {
                // The value was received: the receiver finds no sender to release.
                Outcome::Held => Outcome::Done,
                _ => Outcome::Stale,
            };
            Waiter::set_outcome(node, now);
            (outcome, former)
        }
    }

    /// Makes a waiting operation wake the poller that the renewal is of; returns its outcome. A
    /// `locked` that was taken already is used, and released.
    ///
    /// # Safety
    ///
    /// The caller is the future of `node`, which was listed in this channel and was not withdrawn.
    /// `locked` is that of this channel.
    pub(crate) unsafe fn renew_wake_handle(
        &self,
        mut locked: Option<Locked<'_, T>>,
        node: NonNull<Waiter<T>>,
        mut renewal: Renewal<'_, '_>,
    ) -> Outcome {
        renewal.put(|renewal| {
            let _locked = locked.take().unwrap_or_else(|| self.lock());
            // SAFETY: under the lock a waiting node may be changed.
            unsafe {
                let outcome = Waiter::outcome(node);
                if matches!(outcome, Outcome::Waiting | Outcome::Held) {
                    renewal.store(Waiter::change_wake_handle(node));
                }
                outcome
            }
        })
    }

    /// Returns a value to the channel whose receive was dropped before it could hand the value on:
    /// it goes to the next receiver, before all others. It cannot be received from a
    /// poisoned channel, where it is dropped. An overwriting buffer that has become full in the
    /// meantime drops what it would have dropped had the value never left. Allocates only if more
    /// than [`SPARE`] values, or one for each receiver, are back at once.
    pub(crate) fn return_value(&self, value: T) {
        let mut locked = self.lock();
        if locked.lists.ending == Ending::Poisoned {
            drop(locked);
            drop(value);
            return;
        }
        // Also by an extended rendezvous, which finds no sender to hold: its sender has gone on, or
        // is released right after this.
        if let Some(receiver) = locked.commit_receiver(true) {
            // SAFETY: it was just committed; a receiver's node holds no value before it is done.
            let ready = unsafe {
                Waiter::put_value_of(receiver, value);
                Waiter::settle(receiver, Outcome::Done)
            };
            drop(locked);
            ready.wake();
            return;
        }
        let buffer = self.buffer();
        let overwritten = locked.with_store(|store| {
            store.push_front(value);
            let length = store.len();
            match buffer.when_full {
                WhenFull::DropOldest if length > buffer.capacity => store.pop_front(),
                // The newest stays: it has replaced the one before it.
                WhenFull::DropNewest if length > buffer.capacity => store.remove(length - 2),
                _ => None,
            }
        });
        locked.announce();
        locked.release();
        // Drop of the user's value: not under the lock.
        drop(overwritten);
    }

    /// Lists an alternative's entry for this channel; returns whether the channel is ready, in
    /// which case the entry counts as announced.
    ///
    /// # Safety
    ///
    /// The entry is for this channel, is listed nowhere, and stays where it is until
    /// [`unregister`](Self::unregister).
    pub(crate) unsafe fn register(&self, entry: NonNull<Entry<T>>) -> bool {
        let mut locked = self.lock();
        // SAFETY: the entry's first field is its wait node. It is in no list, and stays until
        // `unregister` takes it off, as is demanded here.
        unsafe {
            let priority = current::priority();
            locked.lists.registered.insert(entry.cast(), priority, None);
        }
        locked.lists.find_whether_plain();
        let is_ready = locked.is_ready();
        // SAFETY: the lock is held that guards it from here on.
        unsafe { (*entry.as_ptr()).is_queued = is_ready };
        is_ready
    }

    /// Takes an alternative's entry off.
    ///
    /// # Safety
    ///
    /// The entry is registered here.
    pub(crate) unsafe fn unregister(&self, entry: NonNull<Entry<T>>) {
        let mut locked = self.lock();
        // SAFETY: the entry is in this channel's list of registered ones, as is demanded here, and
        // the lock is held.
        unsafe { locked.lists.registered.remove(entry.cast()) };
        locked.lists.find_whether_plain();
    }

    /// Wakes the registered alternatives that have a report, without the lock. O(registered
    /// alternatives) for each of them.
    #[inline]
    pub(crate) fn ring(&self) {
        if self.rings.load(Ordering::Relaxed) {
            self.ring_all();
        }
    }

    #[cold]
    fn ring_all(&self) {
        loop {
            let locked = self.lock();
            let mut next = locked.lists.registered.first();
            let closed = loop {
                let Some(node) = next else {
                    self.rings.store(false, Ordering::Relaxed);
                    return;
                };
                let entry = node.cast::<Entry<T>>();
                // SAFETY: a node in the list is that of a live entry, which the lock guards.
                unsafe {
                    if core::mem::take(&mut (*entry.as_ptr()).rings) {
                        break Entry::select_state(entry).close();
                    }
                    next = locked.lists.registered.after(node);
                }
            };
            drop(locked);
            if let Some(wake_handle) = closed {
                let rest = Finally::new(|| self.ring_all());
                wake_handle.take().wake();
                rest.cancel();
            }
        }
    }

    /// Lets the sender go on that was held in rendezvous `ticket`, if it has not gone already.
    /// O(held senders).
    pub(crate) fn release_held(&self, ticket: u32) {
        self.finish_held(ticket, |_| Outcome::Done);
    }

    /// Lets the sender go on that was held in rendezvous `ticket`; if it is still there, calls
    /// `last` with it before, under the lock, to set its result. O(held senders).
    pub(crate) fn finish_held(
        &self,
        ticket: u32,
        last: impl FnOnce(NonNull<Waiter<T>>) -> Outcome,
    ) {
        if ticket == 0 {
            return;
        }
        let mut locked = self.lock();
        let Some(sender) = locked.held(ticket) else {
            return;
        };
        let outcome = last(sender);
        // SAFETY: it is in the list, so it is a live waiter that the lock guards; its result is
        // set.
        let ready = unsafe {
            locked.lists.held.remove(sender.cast());
            Waiter::settle(sender, outcome)
        };
        drop(locked);
        ready.wake();
    }

    /// Number of buffered values. For display: it may have changed already.
    pub(crate) fn buffered(&self) -> usize {
        self.lock().with_store(|store| store.len())
    }
}
