//! Fast path of a registered alternative and its senders: the steps of
//! [`fast_path`](super::fast_path), with an [`Alternative`](crate::Alternative) on the receiving
//! side.

use super::fast_path::take_from_first;
use super::{Channel, FastPath};
use crate::alternative::Entry;
use crate::wait_point::{LastUser, WaitQueues};
use crate::waiter::Waiter;
use luna_core::current::{PlainPendingWake, PlainTurn};
use std::ptr::NonNull;

impl<T> Channel<T> {
    /// Sends to the alternative that is registered here, or lists the sender and reports the
    /// channel to it.
    ///
    /// # Safety
    ///
    /// As for [`meet_found`](Self::meet_found), of a send that has found `Registered`: the lists
    /// are plain but for one registered alternative.
    #[inline(never)]
    pub(super) unsafe fn send_to_registered(
        &self,
        sender: NonNull<Waiter<T>>,
        turn: PlainTurn<'_>,
    ) -> FastPath {
        // SAFETY: the contract: the executor has kept the lock.
        let mut lists = unsafe { self.wait_point.kept(turn) };
        if !lists.receivers.is_empty() || !lists.senders.is_empty() {
            return FastPath::No;
        }
        let Some(node) = lists.registered.first() else {
            return FastPath::No;
        };
        let entry = node.cast::<Entry<T>>();
        let receiver = node.cast::<Waiter<T>>();
        // SAFETY: a registered node is that of a live entry, which the lock guards.
        let committed = unsafe { Entry::commit_or_announce(entry, turn) };
        match committed {
            None => FastPath::No,
            // SAFETY: the contract; the entry was just committed, and holds no value before it is
            // done.
            Some(Some(ready)) => unsafe {
                lists.sender = LastUser::process(turn.process().id());
                Waiter::put_value_of(receiver, Waiter::take_value_of(sender));
                Waiter::settle_plain(receiver);
                drop(lists);
                go_on(ready, turn)
            },
            // SAFETY: by the contract on `sender` and the lock; no other node is listed.
            Some(None) => unsafe { wait_as_sender(&mut lists, sender, turn) },
        }
    }

    /// Receives for a registered alternative from a plain sender, if that is the first to wait;
    /// then reports under the lock whether no other waits. `None`: not possible here, or `still`
    /// returned false under the lock; no state changed.
    #[inline(always)]
    pub(crate) fn take_sender_if(
        &self,
        turn: PlainTurn<'_>,
        still: impl FnOnce() -> bool,
        note: impl FnOnce(bool),
    ) -> Option<(T, PlainPendingWake)> {
        let mut lists = self.wait_point.lock_if_biased(turn)?;
        if !lists.is_plain_but_registered() || lists.is_storing || !still() {
            return None;
        }
        let first = lists.senders.first()?;
        // SAFETY: under the lock a listed node is one of this channel's, and a sender's holds its
        // value.
        let taken = unsafe { take_from_first::<T>(&mut lists, first, turn) }?;
        note(lists.senders.is_empty());
        Some(taken)
    }
}

/// Lists a sender.
///
/// # Safety
///
/// As for [`meet_fast`](Channel::meet_fast); and no node is listed on either side.
#[inline(always)]
unsafe fn wait_as_sender<T>(
    lists: &mut WaitQueues,
    node: NonNull<Waiter<T>>,
    turn: PlainTurn<'_>,
) -> FastPath {
    lists.sender = LastUser::process(turn.process().id());
    // SAFETY: the contract.
    unsafe {
        Waiter::begin_plain(node, turn);
        lists.senders.insert_into_empty(node.cast());
    }
    FastPath::Waits
}

/// Wakes the partner, and lets others run before the current process if they are to.
///
/// # Safety
///
/// The wake handle was made on this thread.
#[inline(always)]
unsafe fn go_on(ready: PlainPendingWake, turn: PlainTurn<'_>) -> FastPath {
    // SAFETY: the contract.
    unsafe { ready.wake() };
    FastPath::done(turn)
}
