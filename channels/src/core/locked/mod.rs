//! The steps on a channel under its lock, and which waiting partner is taken.

mod transfer;

use super::{Channel, Ending};
use crate::alternative::Entry;
use crate::replay::Stamped;
use crate::wait_point::{Lists, WaitQueues, user_number};
use crate::waiter::{Outcome, Waiter};
use alloc::collections::VecDeque;
use core::fmt;
use core::hint::cold_path;
use core::ptr::NonNull;
use luna_core::biased_lock::BiasedGuard;
use luna_core::current::{Here, Inheritor, PendingWake, Priority};
use luna_core::events;
use luna_core::wait_list::{WaitList, WaitNode};
use luna_platform::sync::atomic::Ordering;

/// Result of an operation under the lock.
#[derive(Debug)]
pub enum Attempted {
    /// It has happened. Wake the partner.
    Done(PendingWake),
    /// A send, as `Done`. Its node holds what the buffer has dropped for its value.
    Overwrote(PendingWake),
    /// A receiver has the value, and holds the sender; the sender's node is listed as held. Wake
    /// the receiver, and [give](Channel::renew_wake_handle) the node a wake handle if it has none.
    Held(PendingWake),
    /// A receive, as `Done`. It holds its sender of this priority, which waits on.
    Holds(Priority),
    /// It would have to wait.
    NotNow,
    /// It will never happen.
    Ended(Ending),
    /// The sender's value could not be made. Wake the partner, and poison the channel.
    Broken(PendingWake),
}

impl Attempted {
    /// There is no process to wake.
    pub(crate) const DONE: Attempted = Attempted::Done(PendingWake::NONE);

    /// The process to wake.
    pub(crate) fn into_wake(self) -> PendingWake {
        match self {
            Attempted::Done(ready)
            | Attempted::Overwrote(ready)
            | Attempted::Held(ready)
            | Attempted::Broken(ready) => ready,
            Attempted::Holds(_) | Attempted::NotNow | Attempted::Ended(_) => PendingWake::NONE,
        }
    }
}

/// The channel with its lock held.
pub struct ChannelGuard<'a, T, L> {
    pub(super) channel: &'a Channel<T>,
    /// The lists of `channel`.
    pub(crate) lists: L,
    /// The thread that holds the lock.
    pub(super) here: Here<'a>,
}

impl<T, L> fmt::Debug for ChannelGuard<'_, T, L> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ChannelGuard")
    }
}

/// A channel guard that holds the lock itself.
pub(crate) type Locked<'a, T> = ChannelGuard<'a, T, BiasedGuard<'a, WaitQueues>>;

impl<'a, T, L: Lists> ChannelGuard<'a, T, L> {
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

    /// The thread that holds the lock.
    #[inline]
    pub(crate) fn here(&self) -> Here<'a> {
        self.here
    }

    /// Reports to the registered alternatives that the channel is ready. They are then to be
    /// [rung](Channel::ring) for. O(those without the report).
    #[inline]
    pub(crate) fn announce(&mut self) {
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

    /// Lets an operation wait. O(1), or O(waiting ones of its side of lower priority).
    ///
    /// # Safety
    ///
    /// `node` was begun, as a sender's with its value or with what makes it, or as a receiver's
    /// without. It is not listed, and stays where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn list(&mut self, is_sender: bool, node: NonNull<Waiter<T>>) {
        let lists = &mut *self.lists;
        // SAFETY: the node is in no list, stays where it is, and its future withdraws it before it
        // goes, as is demanded here. It was begun, so its link can be read. The wait node is its
        // first field.
        unsafe {
            if is_sender {
                lists.senders.insert_again(node.cast());
                self.boost_while_they_wait();
                self.announce();
            } else {
                if Waiter::begun(node).holds() && !lists.extends {
                    lists.extends = true;
                    lists.find_whether_plain();
                }
                lists.receivers.insert_again(node.cast());
            }
        }
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

    /// Lists the operations that wait on the hand-off slots: from here on all is as if there were
    /// no hand-off slots.
    #[inline]
    pub(crate) fn list_from_slots(&mut self) {
        self.channel.wait_point.clear_slots(&mut self.lists);
    }

    /// Releases the lock, and wakes the registered alternatives with a report made under it.
    #[inline]
    pub(crate) fn release(self) {
        let channel = self.channel;
        drop(self);
        channel.ring();
    }

    /// Claims the first registered alternative that waits and that `accepts` admits for its
    /// priority. Its node stays listed.
    #[cold]
    pub(super) fn commit_registered(
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
            return self.commit_listed(may_hold);
        }
        cold_path();
        let first = self.lists.receivers.first();
        // SAFETY: a node in the list is live, and the lock is held.
        let first = first.map(|node| unsafe { node.as_ref() }.priority());
        self.commit_registered(|priority| first.is_none_or(|first| priority > first))
            .or_else(|| self.commit_listed(may_hold))
            .or_else(|| self.commit_registered(|_| true))
    }

    #[inline]
    pub(super) fn commit_listed(&mut self, may_hold: bool) -> Option<NonNull<Waiter<T>>> {
        let accepts = |node: NonNull<WaitNode>| {
            // SAFETY: a node in the list of receivers is a live waiter that the lock guards.
            may_hold || !unsafe { Waiter::<T>::begun(node.cast()) }.holds()
        };
        // SAFETY: the nodes in the list are waiters of this channel, whose lock is held.
        unsafe { commit_first::<T>(&mut self.lists.receivers, accepts) }
    }

    /// Takes a waiting sender out of the list, settled or held in an extended rendezvous, and moves
    /// its value into the receiver's node, or into the store without one.
    ///
    /// # Safety
    ///
    /// `receiver` is in no queue: it is new, or the entry of a registered alternative with a closed
    /// select state. No other thread accesses its value, and it holds none.
    #[inline]
    pub(super) unsafe fn take_waiting_sender(
        &mut self,
        receiver: Option<NonNull<Waiter<T>>>,
        extended: bool,
    ) -> Attempted {
        // SAFETY: the nodes in the list are senders' waiters of this channel, whose lock is held.
        // They hold or make their value once.
        unsafe {
            let Some(sender) = commit_first::<T>(&mut self.lists.senders, |_| true) else {
                return Attempted::NotNow;
            };
            let Some(value) = Waiter::take_or_make(sender, Waiter::make(sender)) else {
                return Attempted::Broken(Waiter::settle(sender, Outcome::Broken));
            };
            if self.lists.is_unusual {
                Waiter::put_order(sender, self.lists.stamp(Stamped::Meeting));
            }
            self.channel.wait_point.report(|| {
                let receiver = receiver.map_or(0, |_| events::current_process());
                [user_number(sender.cast()), receiver]
            });
            match receiver {
                Some(receiver) => Waiter::put_value_of(receiver, value),
                None => self.with_store(|store| store.push_back(value)),
            }
            if !extended {
                return Attempted::Done(Waiter::settle(sender, Outcome::Done));
            }
            // The sender waits on, and keeps its wake handle.
            self.hold(sender);
            Attempted::Holds((*Waiter::link(sender)).wait.priority())
        }
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
    // SAFETY: the nodes in the list are waiters of this type, and the lock is held: so the first
    // one is live, and can be looked at and taken off. The rest demands the same of the list.
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
/// As for [`commit_first`]: the nodes are waiters of values of this type, and the lock is held that
/// guards them.
#[cold]
unsafe fn commit_first_of_many<T>(
    list: &mut WaitList,
    accepts: impl Fn(NonNull<WaitNode>) -> bool,
) -> Option<NonNull<Waiter<T>>> {
    let mut next = list.first();
    while let Some(node) = next {
        // SAFETY: the nodes in the list are waiters of this type, and the lock is held: so each is
        // live until it is settled. Its follower is read before. One that could not be committed is
        // stale, and is settled after it was taken off.
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
            Waiter::set_outcome(waiter, Outcome::Stale);
        }
    }
    None
}
