//! Fast path of a registered alternative and its senders: the steps of
//! [`prologue`](super::prologue), with an [`Alternative`](crate::Alternative) on the receiving
//! side.

use super::prologue::{Plain, depart, go_on_inside};
use super::{Channel, FastPath};
use crate::alternative::Entry;
use crate::wait_point::{LastUser, WaitPoint, WaitQueues};
use crate::waiter::{Outcome, Waiter};
use core::ptr::NonNull;
use luna_core::current::{PlainPendingWake, PlainTurn};
use luna_core::wait_list::WaitNode;

impl<T> Channel<T> {
    /// Sends to the alternative that is registered here, or lets the sender wait alone and reports
    /// the channel to the alternative.
    ///
    /// # Safety
    ///
    /// As for [`Meet`](super::Meet), of a send where `waiting` is `REGISTERED`.
    pub(super) unsafe fn send_to_registered(
        channel: NonNull<WaitPoint>,
        sender: NonNull<Waiter<()>>,
        turn: PlainTurn<'_>,
    ) -> FastPath {
        // SAFETY: this thread has kept the lock, and takes it back once in each way; the wait point
        // is that of a live channel of values of this type: `Meet` demands that. A registered node
        // is that of a live entry, which the lock guards, as its alternative's. No thread holds a
        // commit lock across a poll, and this one enters it once, by its bias. A committed entry
        // holds no value before it is done; a new send's node holds one.
        unsafe {
            let wait_point = channel.as_ref();
            let lists = wait_point.kept(turn);
            let Some(node) = lists.registered.first() else {
                return go_on_inside(lists);
            };
            let select_state = Entry::<T>::select_state(node.cast());
            let committed = match select_state.commit_lock_if_biased(turn.here()) {
                Some(mut opening) => Entry::<T>::commit_or_announce(node.cast(), &mut opening),
                None => None,
            };
            match committed {
                None => go_on_inside(lists),
                Some(None) => Plain::<true>::new(channel, sender, turn).wait_alone(lists),
                Some(Some(ready)) => {
                    let value = Waiter::<T>::take_value_of(sender.cast());
                    Waiter::<T>::put_value_of(node.cast(), value);
                    depart::<true>(wait_point, lists, (node, ready), turn)
                }
            }
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
        let mut lists = self.wait_point.enter_in(turn.here())?;
        if !lists.is_plain_but_registered() || lists.is_storing || !still() {
            return None;
        }
        // SAFETY: under the lock a node that waits is one of this channel's, and a sender's holds
        // its value. One that waits alone was begun so by this executor.
        let taken = unsafe {
            match lists.waiting.one(true) {
                Some(sender) => {
                    let ready = WaitNode::take_alone(sender.as_ptr());
                    lists.set_nothing_waits();
                    taken_from(&mut lists, sender, ready, turn)
                }
                None => {
                    let first = lists.senders.first()?;
                    let ready = Waiter::<()>::take_plain_wake_handle(first.cast())?;
                    lists.senders.remove_first(first);
                    taken_from(&mut lists, first, ready, turn)
                }
            }
        };
        note(lists.senders.is_empty());
        Some(taken)
    }
}

/// Takes the value of a sender that was taken off. The caller wakes it when the lock is released.
///
/// # Safety
///
/// It is a plain send of this channel of values of this type; this executor holds the lock.
#[inline(always)]
unsafe fn taken_from<T>(
    lists: &mut WaitQueues,
    sender: NonNull<WaitNode>,
    ready: PlainPendingWake,
    turn: PlainTurn<'_>,
) -> (T, PlainPendingWake) {
    lists.note_user(false, LastUser::process(turn.process().id()));
    // SAFETY: the sender waited, so it holds its value. It was taken off under the lock that is
    // held, and its value is moved out before it is settled as done.
    unsafe {
        let value = Waiter::<T>::take_value_of(sender.cast());
        Waiter::<T>::set_outcome(sender.cast(), Outcome::Done);
        (value, ready)
    }
}
