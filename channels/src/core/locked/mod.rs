//! The steps on a channel under its lock.

mod partners;
mod recv;
mod send;

use super::{Channel, Ending};
use crate::alternative::Entry;
use crate::wait_point::WaitQueues;
use crate::waiter::Waiter;
use alloc::collections::VecDeque;
use core::fmt;
use core::ops::DerefMut;
use core::ptr::NonNull;
use luna_core::biased_lock::BiasedGuard;
use luna_core::current::{Here, Inheritor, PendingWake, Priority};
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

impl<'a, T, L: DerefMut<Target = WaitQueues>> ChannelGuard<'a, T, L> {
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
}

impl<T, L: DerefMut<Target = WaitQueues>> ChannelGuard<'_, T, L> {
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
}
