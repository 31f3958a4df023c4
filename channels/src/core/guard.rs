//! The steps on a channel under its lock.

use super::{Channel, Ending};
use crate::alternative::Entry;
use crate::buffer::WhenFull;
use crate::call::boost_to_receiver;
use crate::replay::{self, Stamped};
use crate::source::{Offered, Source};
use crate::wait_point::{LastUser, WaitQueues, user_number};
use crate::waiter::{Outcome, Waiter};
use luna_core::biased_lock::BiasedGuard;
use luna_core::current::{self, Inheritor, PendingWake, Priority, WakeHandle};
use luna_core::events;
use luna_core::wait_list::{WaitList, WaitNode};
use luna_platform::sync::atomic::Ordering;
use std::collections::VecDeque;
use std::hint::cold_path;
use std::ops::{Deref, DerefMut};
use std::ptr::NonNull;
use std::task::Context;
/// Result of a send under the lock.
pub(crate) enum Sent<T> {
    /// A receiver has it, or the buffer. Wake the receiver; drop what was overwritten.
    Done(PendingWake, Option<T>),
    /// A receiver has it, and holds the sender; the sender's node is listed as held. Wake the
    /// receiver, and [give](Channel::update_wake_handle) the node a wake handle if it has none.
    Held(PendingWake),
    /// No receiver takes it now.
    Full,
    /// No receiver will ever take it.
    Ended(Ending),
    /// The value could not be made. Wake the receiver that was to have it, and poison the channel.
    Broken(PendingWake),
}

/// Result of a receive under the lock.
pub(crate) enum Received<T> {
    /// A value, the process to wake, and the held sender.
    Done(T, PendingWake, Holding),
    Empty,
    Ended(Ending),
    /// The sender's value could not be made. Wake the sender, and poison the channel.
    Broken(PendingWake),
}

/// The sender that is held in an extended rendezvous.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Holding {
    /// Number of the rendezvous; 0 if no sender is held.
    pub(crate) ticket: u32,
    /// Priority of the sender.
    pub(crate) priority: Priority,
}

impl Holding {
    pub(crate) const NONE: Holding = Holding {
        ticket: 0,
        priority: Priority {
            thread: 0,
            level: 0,
        },
    };
}

/// The channel with its lock held.
pub(crate) struct ChannelGuard<'a, T, L> {
    pub(super) channel: &'a Channel<T>,
    /// The lists of `channel`.
    pub(crate) lists: L,
}

/// A channel guard that holds the lock itself.
pub(crate) type Locked<'a, T> = ChannelGuard<'a, T, BiasedGuard<'a, WaitQueues>>;

impl<T, L: Deref<Target = WaitQueues> + DerefMut> ChannelGuard<'_, T, L> {
    #[inline]
    pub(super) fn with_store<R>(&mut self, f: impl FnOnce(&mut VecDeque<T>) -> R) -> R {
        let lists = &mut *self.lists;
        self.channel.store.with_mut(|store| {
            // SAFETY: the lock is held for as long as this guard is, and the guard is borrowed
            // exclusively.
            let store = unsafe { &mut *store };
            let done = f(store);
            lists.is_storing = !store.is_empty();
            done
        })
    }

    /// Whether a receive would not have to wait. A sender that has chosen another guard may still
    /// count.
    pub(crate) fn is_ready(&mut self) -> bool {
        self.lists.ending != Ending::Open || !self.lists.senders.is_empty() || self.lists.is_storing
    }

    /// Reports to the registered alternatives that the channel is ready. They are then to be
    /// [rung](Channel::ring) for. O(those without the report).
    #[inline]
    pub(super) fn announce(&mut self) {
        if !self.lists.registered.is_empty() {
            self.announce_to_all();
        }
    }

    #[cold]
    fn announce_to_all(&mut self) {
        let mut next = self.lists.registered.first();
        while let Some(node) = next {
            // SAFETY: a node in the list is that of a live entry, which the lock guards.
            unsafe {
                if Entry::<T>::announce(node.cast()) {
                    self.channel.rings.store(true, Ordering::Relaxed);
                }
                next = self.lists.registered.after(node);
            }
        }
    }

    /// Claims the first registered alternative that waits and that `accepts` admits for its
    /// priority. Its node stays listed.
    #[cold]
    fn commit_registered(
        &mut self,
        accepts: impl Fn(Priority) -> bool,
    ) -> Option<NonNull<Waiter<T>>> {
        let mut next = self.lists.registered.first();
        while let Some(node) = next {
            // SAFETY: a node in the list is that of a live entry, and an entry's first field is its
            // waiter.
            unsafe {
                let waiter = node.cast::<Waiter<T>>();
                if accepts(node.as_ref().priority())
                    && !Entry::<T>::has_news(node.cast())
                    && Waiter::commit(waiter)
                {
                    return Some(waiter);
                }
                next = self.lists.registered.after(node);
            }
        }
        None
    }

    /// Takes out the most urgent receiver that can still be committed. The caller settles it.
    #[inline]
    pub(crate) fn commit_receiver(&mut self, may_hold: bool) -> Option<NonNull<Waiter<T>>> {
        if self.lists.registered.is_empty() {
            self.commit_listed(may_hold)
        } else {
            self.commit_any(may_hold)
        }
    }

    #[cold]
    fn commit_any(&mut self, may_hold: bool) -> Option<NonNull<Waiter<T>>> {
        // SAFETY: a node in the list is live, and the lock is held.
        let priority_of = |node: NonNull<WaitNode>| unsafe { node.as_ref() }.priority();
        let first = self.lists.receivers.first().map(priority_of);
        self.commit_registered(|priority| first.is_none_or(|first| priority > first))
            .or_else(|| self.commit_listed(may_hold))
            .or_else(|| self.commit_registered(|_| true))
    }

    #[inline]
    fn commit_listed(&mut self, may_hold: bool) -> Option<NonNull<Waiter<T>>> {
        let accepts = |node: NonNull<WaitNode>| {
            // SAFETY: a node in the list of receivers is a live waiter that the lock guards.
            may_hold || !unsafe { (*Waiter::<T>::link(node.cast())).extended }
        };
        // SAFETY: the nodes in the list are waiters.
        unsafe { commit_first::<T>(&mut self.lists.receivers, accepts) }
    }

    /// Takes a waiting sender's value, and its node out of the list: settled, or held for
    /// rendezvous `ticket`.
    #[inline]
    fn take_waiting_sender(&mut self, extended: bool, into_store: bool) -> Option<Received<T>> {
        // SAFETY: the nodes in the list are senders' waiters, which hold or make their value once.
        unsafe {
            let sender = commit_first::<T>(&mut self.lists.senders, |_| true)?;
            let Some(value) = Waiter::take_or_make(sender) else {
                return Some(Received::Broken(Waiter::settle(sender, Outcome::Broken)));
            };
            if self.lists.is_unusual {
                Waiter::put_order(sender, self.lists.stamp(Stamped::Meeting));
            }
            self.channel.wait_point.report(|| {
                let receiver = match into_store {
                    true => 0,
                    false => events::current_process(),
                };
                [user_number(sender.cast()), receiver]
            });
            if !extended {
                let ready = Waiter::settle(sender, Outcome::Done);
                return Some(Received::Done(value, ready, Holding::NONE));
            }
            let ticket = self.next_ticket();
            // The sender waits on, and keeps its wake handle.
            self.lists.held.insert_again(sender.cast());
            Self::hold(sender, ticket);
            let holding = Holding {
                ticket,
                priority: (*Waiter::link(sender)).wait.priority(),
            };
            Some(Received::Done(value, PendingWake::NONE, holding))
        }
    }

    /// Records that the current process gives its value to this receiver.
    ///
    /// # Safety
    ///
    /// It was committed, and is not settled.
    #[inline(always)]
    unsafe fn report_sent(&self, receiver: NonNull<Waiter<T>>) {
        let wait_point = &self.channel.wait_point;
        // SAFETY: the contract, and the lock is held.
        wait_point.report(|| unsafe { [events::current_process(), user_number(receiver.cast())] });
    }

    fn next_ticket(&mut self) -> u32 {
        self.lists.tickets = self.lists.tickets.checked_add(1).unwrap_or(1);
        self.lists.tickets
    }

    /// # Safety
    ///
    /// `node` is that of a committed sender after its value was taken. It is in the list of held
    /// senders, and stays where it is until it is settled or withdrawn.
    unsafe fn hold(node: NonNull<Waiter<T>>, ticket: u32) {
        // SAFETY: the contract; the lock is held.
        unsafe {
            let link = Waiter::link(node);
            (*link).ticket = ticket;
            (*link)
                .outcome
                .store(Outcome::Held as u8, Ordering::Release);
        }
    }

    /// Sends at once, if possible. O(1). If a receiver holds its sender and `cx` has the waker for
    /// the release, the node is listed as held.
    ///
    /// # Safety
    ///
    /// `offered` is not listed, no other thread accesses it, and it holds its value or can make it.
    /// With `cx`, it stays where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn send_now<S: Source<T>>(
        &mut self,
        offered: NonNull<Offered<T, S>>,
        cx: Option<&Context<'_>>,
    ) -> Sent<T> {
        // SAFETY: the contract.
        unsafe { self.send_inline(offered, cx) }
    }

    /// As [`send_now`](Self::send_now), inlined at each call: for callers that do little else.
    ///
    /// # Safety
    ///
    /// As there.
    #[inline(always)]
    pub(crate) unsafe fn send_inline<S: Source<T>>(
        &mut self,
        offered: NonNull<Offered<T, S>>,
        cx: Option<&Context<'_>>,
    ) -> Sent<T> {
        self.lists.sender = LastUser::of(current::user());
        if self.lists.is_unusual {
            cold_path();
            if self.lists.ending != Ending::Open {
                return Sent::Ended(self.lists.ending);
            }
            self.lists.note_partner();
        }
        let buffer = self.channel.buffer();
        // A buffer takes the value from its sender as soon as it has it, and holds no sender: any
        // send finds any receiver there.
        let may_hold = cx.is_some() || buffer.capacity != 0;
        if self.lists.extends
            && buffer.capacity == 0
            && let Some(cx) = cx
        {
            // SAFETY: the contract.
            return unsafe { self.send_or_be_held(offered, cx) };
        }
        if let Some(receiver) = self.commit_receiver(may_hold) {
            // SAFETY: the contract; the receiver was just committed, and holds no value before it
            // is done.
            return unsafe {
                match Offered::take(offered) {
                    Some(value) => {
                        receiver.as_ref().put_value(value);
                        self.report_sent(receiver);
                        if self.lists.is_unusual {
                            Waiter::put_order(receiver, self.lists.stamp(Stamped::Meeting));
                        }
                        Sent::Done(Waiter::settle(receiver, Outcome::Done), None)
                    }
                    None => Sent::Broken(Waiter::settle(receiver, Outcome::Poisoned)),
                }
            };
        }
        if buffer.capacity == 0 {
            return Sent::Full;
        }
        // A replayed sender got through in the record too: the receiver that made room then may
        // take several values at once later.
        let is_replayed = self.lists.is_unusual && replay::is_replayed();
        let is_full = !is_replayed && self.with_store(|store| store.len() >= buffer.capacity);
        if is_full && buffer.when_full == WhenFull::Wait {
            return Sent::Full;
        }
        // SAFETY: the contract.
        let Some(value) = (unsafe { Offered::take(offered) }) else {
            return Sent::Broken(PendingWake::NONE);
        };
        if self.lists.is_unusual {
            let stamp = self.lists.stamp(Stamped::Storing);
            if is_replayed {
                let stored = self.with_store(|store| store.len());
                self.lists.note_stored(stamp, stored);
            }
        }
        let wait_point = &self.channel.wait_point;
        wait_point.report(|| [events::current_process(), 0]);
        let overwritten = self.with_store(|store| {
            let overwritten = match buffer.when_full {
                WhenFull::DropOldest if is_full => store.pop_front(),
                WhenFull::DropNewest if is_full => store.pop_back(),
                _ => None,
            };
            store.push_back(value);
            overwritten
        });
        self.announce();
        Sent::Done(PendingWake::NONE, overwritten)
    }

    /// Sends without a buffer, where receivers may hold their senders.
    ///
    /// # Safety
    ///
    /// As for `send_now`.
    #[cold]
    unsafe fn send_or_be_held<S: Source<T>>(
        &mut self,
        offered: NonNull<Offered<T, S>>,
        cx: &Context<'_>,
    ) -> Sent<T> {
        let Some(receiver) = self.commit_receiver(true) else {
            return Sent::Full;
        };
        // SAFETY: the contract; the receiver was just committed, and holds no value before it is
        // done.
        unsafe {
            let Some(value) = Offered::take(offered) else {
                return Sent::Broken(Waiter::settle(receiver, Outcome::Poisoned));
            };
            receiver.as_ref().put_value(value);
            self.report_sent(receiver);
            // Extended rendezvous are seldom enough for this.
            let stamp = self.lists.stamp(Stamped::Meeting);
            Waiter::put_order(receiver, stamp);
            if !(*Waiter::link(receiver)).extended {
                return Sent::Done(Waiter::settle(receiver, Outcome::Done), None);
            }
            let node = offered.cast::<Waiter<T>>();
            Waiter::begin(node, false, None, S::MAKE);
            Waiter::put_order(node, stamp);
            let ticket = self.next_ticket();
            (*Waiter::link(receiver)).ticket = ticket;
            let priority = current::priority();
            // A waker is not cloned under the lock: the future finds no wake handle, and brings
            // one.
            let wake_handle = WakeHandle::without_waker(cx);
            self.lists.held.insert(node.cast(), priority, wake_handle);
            Self::hold(node, ticket);
            // Before it is woken.
            boost_to_receiver(receiver, priority);
            Sent::Held(Waiter::settle(receiver, Outcome::Done))
        }
    }

    /// Receives at once, if possible. O(1).
    #[inline]
    pub(crate) fn recv_now(&mut self, extended: bool) -> Received<T> {
        self.recv_inline(extended)
    }

    /// As [`recv_now`](Self::recv_now), inlined at each call: for callers that do little else.
    #[inline(always)]
    pub(crate) fn recv_inline(&mut self, extended: bool) -> Received<T> {
        self.lists.receiver = LastUser::of(current::user());
        if self.lists.is_unusual {
            cold_path();
            if self.lists.ending == Ending::Poisoned {
                return Received::Ended(Ending::Poisoned);
            }
            self.lists.note_partner();
        }
        let capacity = self.channel.capacity();
        if let Some((value, has_room)) = self.with_store(|store| {
            let value = store.pop_front()?;
            Some((value, store.len() < capacity))
        }) {
            if self.lists.is_unusual {
                let stamp = self.lists.stamp(Stamped::Taking);
                if replay::is_replayed() {
                    let stored = self.with_store(|store| store.len());
                    self.lists.note_taken(stored + 1, stamp);
                }
            }
            let wait_point = &self.channel.wait_point;
            wait_point.report(|| [0, events::current_process()]);
            // A waiting sender moves up.
            let moved_up = if has_room {
                self.take_waiting_sender(false, true)
            } else {
                None
            };
            let ready = match moved_up {
                Some(Received::Done(next, ready, _)) => {
                    self.with_store(|store| store.push_back(next));
                    ready
                }
                // The value counts as received; the next receive finds the sender gone and the
                // channel as it is.
                Some(Received::Broken(ready)) => ready,
                _ => PendingWake::NONE,
            };
            return Received::Done(value, ready, Holding::NONE);
        }
        match self.take_waiting_sender(extended, false) {
            Some(received) => received,
            None if self.lists.ending == Ending::Closed => Received::Ended(Ending::Closed),
            None => Received::Empty,
        }
    }

    /// In a replay: takes out the values that the buffer had overwritten when the recorded receive
    /// with this stamp came.
    #[cold]
    pub(crate) fn take_overwritten(&mut self, stamp: u64) -> Vec<T> {
        let buffer = self.channel.buffer();
        if buffer.when_full == WhenFull::Wait {
            return Vec::new();
        }
        let stored = self.with_store(|store| store.len());
        let keeps_newest = buffer.when_full == WhenFull::DropOldest;
        let gone = self
            .lists
            .overwritten(stored, buffer.capacity, stamp, keeps_newest);
        self.with_store(|store| store.drain(gone).collect())
    }

    /// Lets a sender wait. O(1), or O(waiting senders of lower priority).
    ///
    /// # Safety
    ///
    /// `node` is a sender's that was begun, holds or can make its value, is not listed, and stays
    /// where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn list_sender(
        &mut self,
        node: NonNull<Waiter<T>>,
        priority: Priority,
        wake_handle: Option<WakeHandle>,
    ) {
        // SAFETY: the contract; the wait node is the first field.
        unsafe {
            self.lists
                .senders
                .insert(node.cast(), priority, wake_handle)
        };
        self.boost_while_they_wait();
        self.announce();
    }

    /// The current process accepts calls here: from now on clients that wait boost it.
    #[inline]
    pub(crate) fn note_server(&mut self) {
        let is_known = self
            .lists
            .server
            .as_ref()
            .is_some_and(Inheritor::is_current);
        if !is_known && self.lists.ending == Ending::Open {
            self.lists.server = Inheritor::current();
            self.lists.find_whether_plain();
            self.boost_while_they_wait();
        }
    }

    /// The server inherits the priority of the most urgent waiting client. To be called when the
    /// waiting clients have changed. O(1), and a system call if the priority of the server's thread
    /// changes by that.
    #[inline]
    pub(crate) fn boost_while_they_wait(&mut self) {
        if self.lists.server.is_some() {
            self.boost_to_server();
        }
    }

    #[cold]
    fn boost_to_server(&mut self) {
        let lists = &mut *self.lists;
        let first = lists.senders.first();
        // SAFETY: a node in the list is live, and the lock is held.
        let most_urgent = first.map(|node| unsafe { node.as_ref() }.priority());
        match (&mut lists.server, most_urgent) {
            (Some(server), Some(priority)) => {
                // It may be ready, and queued at a lower level.
                if server.inherit(priority).is_gt() {
                    server.move_up();
                }
            }
            (Some(server), None) => {
                server.give_back();
            }
            (None, _) => {}
        }
    }

    /// Lets a receiver wait. O(1), or O(waiting receivers of lower priority).
    ///
    /// # Safety
    ///
    /// `node` is a receiver's that was begun, holds no value, is not listed, and stays where it is
    /// until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn list_receiver(
        &mut self,
        node: NonNull<Waiter<T>>,
        priority: Priority,
        wake_handle: Option<WakeHandle>,
    ) {
        // SAFETY: the contract; the wait node is the first field.
        unsafe {
            if (*Waiter::link(node)).extended && !self.lists.extends {
                self.lists.extends = true;
                self.lists.find_whether_plain();
            }
            self.lists
                .receivers
                .insert(node.cast(), priority, wake_handle);
        }
    }
}

impl<T> Locked<'_, T> {
    /// Releases the lock, and wakes the registered alternatives with a report made under it.
    #[inline]
    pub(crate) fn release(self) {
        let channel = self.channel;
        drop(self);
        channel.ring();
    }
}

/// Takes out the first accepted node that can still be committed, and settles the stale ones before
/// it.
///
/// # Safety
///
/// The nodes in the list are waiters of values of this type, and the lock is held that guards them.
#[inline(always)]
unsafe fn commit_first<T>(
    list: &mut WaitList,
    accepts: impl Fn(NonNull<WaitNode>) -> bool,
) -> Option<NonNull<Waiter<T>>> {
    let node = list.first()?;
    // SAFETY: the contract.
    unsafe {
        // The most frequent case: a plain operation, which is accepted, and needs no commit.
        let waiter = node.cast::<Waiter<T>>();
        if Waiter::select_state(waiter).is_none() && accepts(node) {
            list.remove(node);
            return Some(waiter);
        }
        commit_first_of_many(list, accepts)
    }
}

/// # Safety
///
/// As for [`commit_first`].
#[cold]
unsafe fn commit_first_of_many<T>(
    list: &mut WaitList,
    accepts: impl Fn(NonNull<WaitNode>) -> bool,
) -> Option<NonNull<Waiter<T>>> {
    let mut next = list.first();
    while let Some(node) = next {
        // SAFETY: the contract.
        unsafe {
            next = list.after(node);
            if !accepts(node) {
                continue;
            }
            let waiter = node.cast::<Waiter<T>>();
            let is_committed = Waiter::commit(waiter);
            list.remove(node);
            if is_committed {
                return Some(waiter);
            }
            // A stale node holds no wake handle.
            Waiter::settle_stale(waiter);
        }
    }
    None
}
