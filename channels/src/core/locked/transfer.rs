//! A send and a receive under the lock.

use super::{Attempted, ChannelGuard};
use crate::buffer::WhenFull;
use crate::call::boost_to_receiver;
use crate::core::Ending;
use crate::replay::{self, Stamped};
use crate::wait_point::{LastUser, Lists, user_number};
use crate::waiter::{Begun, Make, Outcome, Waiter};
use alloc::vec::Vec;
use core::hint::cold_path;
use core::ptr::NonNull;
use core::task::Context;
use luna_core::current::{PendingWake, WakeHandle};
use luna_core::events;

impl<T, L: Lists> ChannelGuard<'_, T, L> {
    /// Records that the current process gives its value to this receiver.
    ///
    /// # Safety
    ///
    /// It was committed, and is not settled.
    #[inline(always)]
    pub(super) unsafe fn report_sent(&self, receiver: NonNull<Waiter<T>>) {
        let wait_point = &self.channel.wait_point;
        // SAFETY: the receiver was committed and is not settled, so under the lock that this guard
        // holds it is live and no other thread writes its wait node.
        wait_point.report(|| unsafe { [events::current_process(), user_number(receiver.cast())] });
    }

    /// Lists a sender as held; returns the number of the rendezvous.
    ///
    /// # Safety
    ///
    /// `sender` was committed, its value was taken, and it is in no list. It stays where it is
    /// until it is settled or withdrawn.
    pub(super) unsafe fn hold(&mut self, sender: NonNull<Waiter<T>>) -> u32 {
        let ticket = self.lists.tickets.checked_add(1).unwrap_or(1);
        self.lists.tickets = ticket;
        // SAFETY: the sender's value was taken, and the lock is held that guards the node until it
        // is settled: so it is live, and its link can be written. It is in no list, and stays.
        unsafe {
            self.lists.held.insert_again(sender.cast());
            (*Waiter::link(sender)).ticket = ticket;
            Waiter::set_outcome(sender, Outcome::Held);
        }
        ticket
    }

    /// The sender that is held in rendezvous `ticket`, if it has not gone already. O(held senders).
    pub(crate) fn held(&self, ticket: u32) -> Option<NonNull<Waiter<T>>> {
        let mut held = self.lists.held.nodes().map(NonNull::cast::<Waiter<T>>);
        // SAFETY: a node in the list is a live waiter that the lock guards.
        held.find(|&sender| unsafe { (*Waiter::link(sender)).ticket == ticket })
    }

    /// Sends at once, if possible. O(1). If a receiver holds its sender and `cx` has the waker for
    /// the release, the node is listed as held.
    ///
    /// # Safety
    ///
    /// `node` is not listed, no other thread accesses it, and it holds its value, or `make` makes
    /// it. With `cx`, it stays where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn send_now(
        &mut self,
        node: NonNull<Waiter<T>>,
        make: Option<Make<T>>,
        cx: Option<&Context<'_>>,
    ) -> Attempted {
        self.lists.sender = LastUser::of(self.here.user());
        if self.lists.is_unusual {
            cold_path();
            if self.lists.ending != Ending::Open {
                return Attempted::Ended(self.lists.ending);
            }
            self.lists.note_partner();
        }
        let buffer = self.channel.buffer();
        // A buffer takes the value from its sender as soon as it has it, and holds no sender: any
        // send finds any receiver there.
        let may_hold = cx.is_some() || buffer.capacity != 0;
        if let Some(receiver) = self.commit_receiver(may_hold) {
            // SAFETY: the node holds its value, or `make` makes it, and only its future knows it,
            // as is demanded here; with `cx` it stays. The receiver was just committed and taken
            // off, or is a registered entry.
            return unsafe { self.send_to(receiver, node, make, cx) };
        }
        if buffer.capacity == 0 {
            return Attempted::NotNow;
        }
        // A replayed sender got through in the record too: the receiver that made room then may
        // take several values at once later.
        let is_replayed = self.lists.is_unusual && replay::is_replayed();
        let is_full = !is_replayed && self.with_store(|store| store.len() >= buffer.capacity);
        if is_full && buffer.when_full == WhenFull::Wait {
            return Attempted::NotNow;
        }
        // SAFETY: the node holds or can make its value, which no receiver has taken; only its
        // future knows it, as is demanded here.
        let Some(value) = (unsafe { Waiter::take_or_make(node, make) }) else {
            return Attempted::Broken(PendingWake::NONE);
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
        let Some(overwritten) = overwritten else {
            return Attempted::DONE;
        };
        // SAFETY: the node has given its value away, and no other thread knows it.
        unsafe { Waiter::put_value_of(node, overwritten) };
        Attempted::Overwrote(PendingWake::NONE)
    }

    /// Sends to this receiver, which may hold its sender where there is no buffer.
    ///
    /// # Safety
    ///
    /// As for `send_now`: `node` is not listed, no other thread accesses it, it holds its value, or
    /// `make` makes it, and with `cx` it stays where it is until it is settled or withdrawn. The
    /// receiver was committed under this lock. If it holds its sender, there is a buffer or `cx`.
    #[inline]
    unsafe fn send_to(
        &mut self,
        receiver: NonNull<Waiter<T>>,
        node: NonNull<Waiter<T>>,
        make: Option<Make<T>>,
        cx: Option<&Context<'_>>,
    ) -> Attempted {
        // SAFETY: the node holds its value, or it can be made, and only its future knows it until
        // it is in the list `held`, as is demanded here. The receiver was committed, and holds no
        // value before it is done. The lock is held until it is settled.
        unsafe {
            let Some(value) = Waiter::take_or_make(node, make) else {
                return Attempted::Broken(Waiter::settle(receiver, Outcome::Poisoned));
            };
            Waiter::put_value_of(receiver, value);
            self.report_sent(receiver);
            let stamp = match self.lists.is_unusual {
                true => self.lists.stamp(Stamped::Meeting),
                false => 0,
            };
            Waiter::put_order(receiver, stamp);
            let cx = match cx {
                Some(cx) if self.channel.capacity == 0 && Waiter::begun(receiver).holds() => cx,
                _ => return Attempted::Done(Waiter::settle(receiver, Outcome::Done)),
            };
            cold_path();
            // A waker is not cloned under the lock: the future finds no wake handle, and brings
            // one.
            let waits = (self.here, WakeHandle::without_waker(cx));
            Waiter::begin_as(node, waits, Begun::InFull, None, make);
            let priority = (*Waiter::link(node)).wait.priority();
            Waiter::put_order(node, stamp);
            (*Waiter::link(receiver)).ticket = self.hold(node);
            // Before it is woken.
            boost_to_receiver(receiver, priority);
            Attempted::Held(Waiter::settle(receiver, Outcome::Done))
        }
    }

    /// Receives into `node` at once, if possible. O(1).
    ///
    /// # Safety
    ///
    /// `node` is in no queue: it is new, or the entry of a registered alternative with a closed
    /// select state. No other thread accesses its value, and it holds none.
    #[inline]
    pub(crate) unsafe fn recv_now(
        &mut self,
        node: NonNull<Waiter<T>>,
        extended: bool,
    ) -> Attempted {
        self.lists.receiver = LastUser::of(self.here.user());
        if self.lists.is_unusual {
            cold_path();
            if self.lists.ending == Ending::Poisoned {
                return Attempted::Ended(Ending::Poisoned);
            }
            self.lists.note_partner();
        }
        // SAFETY: the node holds no value, and no other thread accesses that, as is demanded here.
        // It still holds none where nothing was stored, so the second call may follow.
        let attempted = unsafe {
            match self.take_stored(node) {
                Some(ready) => Attempted::Done(ready),
                None => self.take_waiting_sender(Some(node), extended),
            }
        };
        if extended {
            let ticket = match attempted {
                Attempted::Holds(_) => self.lists.tickets,
                _ => 0,
            };
            // SAFETY: the node is live, and until it is listed only its future reads this field. It
            // may be written whether the node was begun or not.
            unsafe { (*Waiter::link(node)).ticket = ticket };
        }
        match attempted {
            Attempted::NotNow if self.lists.ending == Ending::Closed => {
                Attempted::Ended(Ending::Closed)
            }
            attempted => attempted,
        }
    }

    /// Moves the first stored value into the node; a waiting sender, which is to be woken, moves
    /// up.
    ///
    /// # Safety
    ///
    /// As for [`recv_now`](Self::recv_now): `node` holds no value, and no other thread accesses
    /// that.
    #[inline]
    pub(super) unsafe fn take_stored(&mut self, node: NonNull<Waiter<T>>) -> Option<PendingWake> {
        let capacity = self.channel.capacity();
        let left = self.with_store(|store| {
            // SAFETY: the node holds no value, and no other thread accesses that, as is demanded
            // here.
            unsafe { Waiter::put_value_of(node, store.pop_front()?) };
            Some(store.len())
        })?;
        if self.lists.is_unusual {
            let stamp = self.lists.stamp(Stamped::Taking);
            if replay::is_replayed() {
                self.lists.note_taken(left + 1, stamp);
            }
        }
        let wait_point = &self.channel.wait_point;
        wait_point.report(|| [0, events::current_process()]);
        if left >= capacity {
            return Some(PendingWake::NONE);
        }
        // SAFETY: it goes into the store. If its value could not be made, the one taken here counts
        // as received all the same; the next receive finds the sender gone and the channel as it
        // is.
        Some(unsafe { self.take_waiting_sender(None, false) }.into_wake())
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
}
