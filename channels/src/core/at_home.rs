//! What two processes of one executor do, when nothing is asked of their channel but to send and to receive: nearly every communication.
//!
//! It comes to what [`Section`](super::Section) comes to, on a way without branches for what is not there: the lock favours the executor, so it is
//! taken and left by plain stores; no waker is cloned or called; nobody is registered, no call is served, nothing is buffered. Whenever one of these
//! does not hold, nothing has been changed, and the general way is gone.
//!
//! A node that was listed here says so ([`Waiter::begin_plain`]), and whoever finds it here knows that its process is of this very home: only the home
//! that a lock favours comes here, and a lock favours no second one.

use super::Channel;
use crate::place::LastUser;
use crate::source::{Offered, Source};
use crate::waiter::Waiter;
use luna_platform::current;
use std::ptr::NonNull;
use std::task::Context;

/// What an operation at home came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum AtHome {
    /// The general way is to be gone: nothing has changed.
    No,
    /// The node is listed.
    Waits,
    /// It is done, and the partner readied.
    Done,
    /// It is done, and the process is ready again: it lets others run first.
    GaveWay,
}

impl<T> Channel<T> {
    /// Sends, or lists the sender. O(1), without atomic read-modify-writes.
    ///
    /// # Safety
    ///
    /// `offered` is not listed, nobody else accesses it, and it holds or makes its value. It stays where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn send_at_home<S: Source<T>>(
        &self,
        offered: NonNull<Offered<T, S>>,
        cx: &Context<'_>,
    ) -> AtHome {
        if S::MAKE.is_some() {
            return AtHome::No;
        }
        let Some(process) = current::plain_turn(cx) else {
            return AtHome::No;
        };
        let home = process.home_number();
        // SAFETY: this is the thread of the process' home. Under the lock a listed node may be changed, and is one of this channel's.
        unsafe {
            let Some(mut lists) = self.place.lock_if_favoured(home) else {
                return AtHome::No;
            };
            if !lists.is_plain {
                return AtHome::No;
            }
            let Some(first) = lists.receivers.first() else {
                if !lists.senders.is_empty() {
                    return AtHome::No;
                }
                lists.sender = LastUser::process(process.id());
                let node = offered.cast::<Waiter<T>>();
                Waiter::begin_plain(node, process);
                lists.senders.insert_alone(node.cast());
                return AtHome::Waits;
            };
            let receiver = first.cast::<Waiter<T>>();
            let Some(ready) = Waiter::take_plain_wakeup(receiver) else {
                return AtHome::No;
            };
            lists.sender = LastUser::process(process.id());
            lists.receivers.remove_first(first);
            Waiter::put_value_of(receiver, offered.as_ref().waiter.take_value());
            Waiter::settle_plain(receiver);
            drop(lists);
            ready.wake();
        }
        match current::gives_way(process) {
            true => AtHome::GaveWay,
            false => AtHome::Done,
        }
    }

    /// Receives into the node, or lists the receiver. O(1), without atomic read-modify-writes.
    ///
    /// # Safety
    ///
    /// `node` is not listed, nobody else accesses it, and it holds no value. It stays where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn recv_at_home(&self, node: NonNull<Waiter<T>>, cx: &Context<'_>) -> AtHome {
        let Some(process) = current::plain_turn(cx) else {
            return AtHome::No;
        };
        let home = process.home_number();
        // SAFETY: as above.
        unsafe {
            let Some(mut lists) = self.place.lock_if_favoured(home) else {
                return AtHome::No;
            };
            // What came back from futures that were dropped goes first.
            if !lists.is_plain || self.store.with(|store| !(*store).is_empty()) {
                return AtHome::No;
            }
            let Some(first) = lists.senders.first() else {
                if !lists.receivers.is_empty() {
                    return AtHome::No;
                }
                lists.receiver = LastUser::process(process.id());
                Waiter::begin_plain(node, process);
                lists.receivers.insert_alone(node.cast());
                return AtHome::Waits;
            };
            let sender = first.cast::<Waiter<T>>();
            let Some(ready) = Waiter::take_plain_wakeup(sender) else {
                return AtHome::No;
            };
            lists.receiver = LastUser::process(process.id());
            lists.senders.remove_first(first);
            Waiter::put_value_of(node, Waiter::take_value_of(sender));
            Waiter::settle_plain(sender);
            drop(lists);
            ready.wake();
        }
        match current::gives_way(process) {
            true => AtHome::GaveWay,
            false => AtHome::Done,
        }
    }
}
