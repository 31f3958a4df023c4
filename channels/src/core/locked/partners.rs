//! Partners that wait: which one is taken, and how.

use super::{Attempted, ChannelGuard};
use crate::alternative::Entry;
use crate::replay::Stamped;
use crate::wait_point::{WaitQueues, user_number};
use crate::waiter::{Outcome, Waiter};
use core::hint::cold_path;
use core::ops::DerefMut;
use core::ptr::NonNull;
use luna_core::current::Priority;
use luna_core::events;
use luna_core::wait_list::{WaitList, WaitNode};

impl<T, L: DerefMut<Target = WaitQueues>> ChannelGuard<'_, T, L> {
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
