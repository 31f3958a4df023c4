//! A send under the lock.

use super::{Attempted, ChannelGuard};
use crate::buffer::WhenFull;
use crate::call::boost_to_receiver;
use crate::core::Ending;
use crate::replay::{self, Stamped};
use crate::source::{Offered, Source};
use crate::wait_point::{LastUser, WaitQueues, user_number};
use crate::waiter::{Begun, Outcome, Waiter};
use core::hint::cold_path;
use core::ops::DerefMut;
use core::ptr::NonNull;
use core::task::Context;
use luna_core::current::{PendingWake, WakeHandle};
use luna_core::events;
use luna_platform::sync::atomic::Ordering;

impl<T, L: DerefMut<Target = WaitQueues>> ChannelGuard<'_, T, L> {
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

    pub(super) fn next_ticket(&mut self) -> u32 {
        self.lists.tickets = self.lists.tickets.checked_add(1).unwrap_or(1);
        self.lists.tickets
    }

    /// # Safety
    ///
    /// `node` is that of a committed sender after its value was taken. It is in the list of held
    /// senders, the lock of which is held, and stays where it is until it is settled or withdrawn.
    pub(super) unsafe fn hold(node: NonNull<Waiter<T>>, ticket: u32) {
        // SAFETY: the sender's value was taken, and the lock is held that guards the node until it
        // is settled: so it is live, and its link can be written.
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
    /// `node` is not listed, no other thread accesses it, and it holds its value or can make it.
    /// With `cx`, it stays where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn send_now<S: Source<T>>(
        &mut self,
        node: NonNull<Offered<T, S>>,
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
        if self.lists.extends
            && buffer.capacity == 0
            && let Some(cx) = cx
        {
            // SAFETY: the node is new, holds or makes its value, and stays with `cx`: this demands
            // of its caller what the callee demands.
            return unsafe { self.send_or_be_held(node, cx) };
        }
        if let Some(receiver) = self.commit_receiver(may_hold) {
            // SAFETY: the node holds or can make its value, and only its future knows it, as is
            // demanded here. The receiver was just committed and taken off, or is a registered
            // entry. It holds no value before it is done, and the lock is held until it is settled.
            return unsafe {
                match Source::take(node) {
                    Some(value) => {
                        receiver.as_ref().put_value(value);
                        self.report_sent(receiver);
                        if self.lists.is_unusual {
                            Waiter::put_order(receiver, self.lists.stamp(Stamped::Meeting));
                        }
                        Attempted::Done(Waiter::settle(receiver, Outcome::Done))
                    }
                    None => Attempted::Broken(Waiter::settle(receiver, Outcome::Poisoned)),
                }
            };
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
        let Some(value) = (unsafe { Source::take(node) }) else {
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
        unsafe { Waiter::put_value_of(node.cast(), overwritten) };
        Attempted::Overwrote(PendingWake::NONE)
    }

    /// Sends without a buffer, where receivers may hold their senders.
    ///
    /// # Safety
    ///
    /// As for `send_now`, with `cx`: `node` is not listed, no other thread accesses it, it holds or
    /// can make its value, and stays where it is until it is settled or withdrawn.
    #[cold]
    pub(super) unsafe fn send_or_be_held<S: Source<T>>(
        &mut self,
        node: NonNull<Offered<T, S>>,
        cx: &Context<'_>,
    ) -> Attempted {
        let Some(receiver) = self.commit_receiver(true) else {
            return Attempted::NotNow;
        };
        // SAFETY: the node holds or can make its value, and only its future knows it until it is in
        // the list `held`, as is demanded here. The receiver was just committed and taken off, or
        // is a registered entry, and holds no value before it is done. The lock is held until it is
        // settled.
        unsafe {
            let Some(value) = Source::take(node) else {
                return Attempted::Broken(Waiter::settle(receiver, Outcome::Poisoned));
            };
            receiver.as_ref().put_value(value);
            self.report_sent(receiver);
            // Extended rendezvous are seldom enough for this.
            let stamp = self.lists.stamp(Stamped::Meeting);
            Waiter::put_order(receiver, stamp);
            if !Waiter::begun(receiver).holds() {
                return Attempted::Done(Waiter::settle(receiver, Outcome::Done));
            }
            let node = node.cast::<Waiter<T>>();
            // A waker is not cloned under the lock: the future finds no wake handle, and brings
            // one.
            let waits = (self.here, WakeHandle::without_waker(cx));
            Waiter::begin_as(node, waits, Begun::InFull, None, S::MAKE);
            let priority = (*Waiter::link(node)).wait.priority();
            Waiter::put_order(node, stamp);
            let ticket = self.next_ticket();
            (*Waiter::link(receiver)).ticket = ticket;
            self.lists.held.insert_again(node.cast());
            Self::hold(node, ticket);
            // Before it is woken.
            boost_to_receiver(receiver, priority);
            Attempted::Held(Waiter::settle(receiver, Outcome::Done))
        }
    }
}
