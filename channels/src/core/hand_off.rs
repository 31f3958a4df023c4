//! Hand-off between two operations that are awake at the same time, on different threads: see
//! [`hand_off_slots`](crate::hand_off_slots).

use super::{Channel, ChannelGuard, Locked};
use crate::hand_off_slots::{Side, has_room};
use crate::source::{Offered, Source};
use crate::wait_point::{LastUser, user_number};
use crate::waiter::{Outcome, Waiter};
use luna_core::current::{self, Renewal};
use luna_core::events;
use luna_core::spin;
use std::ptr::NonNull;
use std::task::Context;

/// Result of an operation at the hand-off slots.
pub(crate) enum HandOff<'a, T, R> {
    /// It is done. There is no process to wake.
    Done(R),
    /// It waits on its hand-off slot, and is to [look](Channel::look_from_slot).
    Waits,
    /// Nothing has happened. The lock is held, and no operation waits on a hand-off slot.
    No(Locked<'a, T>),
}

/// Ends the program if it is dropped.
struct AbortOnDrop;

impl Drop for AbortOnDrop {
    fn drop(&mut self) {
        std::process::abort();
    }
}

impl<T> Channel<T> {
    /// Sends to the receiver that waits on a hand-off slot, or waits on one. O(1).
    ///
    /// # Safety
    ///
    /// `offered` is not listed, no other thread accesses it, and it holds or makes its value. It
    /// stays where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn send_by_slot<S: Source<T>>(
        &self,
        offered: NonNull<Offered<T, S>>,
    ) -> HandOff<'_, T, ()> {
        let hand_off_slots = &self.wait_point.hand_off_slots;
        let node = offered.cast::<Waiter<T>>();
        let mut lists = self.wait_point.lock();
        // SAFETY: the contract: the value lies in the node, unless it is made. On a hand-off slot a
        // receiver's node holds no value, and its future looks at the hand-off slot alone. The lock
        // is held.
        unsafe {
            if S::MAKE.is_none() && lists.may_use_hand_off_slots() {
                if hand_off_slots.is_waiting(Side::Receiver)
                    && let Some(receiver) = lists.hand_off.get(Side::Receiver)
                {
                    lists.sender = LastUser::of(current::user());
                    let wait_point = &self.wait_point;
                    wait_point.report(|| [events::current_process(), user_number(receiver)]);
                    let value = Waiter::take_value_of(node);
                    if has_room::<T>() {
                        hand_off_slots.put(Side::Receiver, value);
                    } else {
                        Waiter::put_value_of(receiver.cast(), value);
                    }
                    hand_off_slots.settle(Side::Receiver);
                    return HandOff::Done(());
                }
                if hand_off_slots.is_free(Side::Sender) && spin::may_look() {
                    lists.sender = LastUser::of(current::user());
                    Waiter::begin_in_slot(node);
                    lists.hand_off.note(Side::Sender, node.cast());
                    if has_room::<T>() {
                        // The value stays in the node too: it is taken from there if the node is
                        // listed.
                        hand_off_slots.put(Side::Sender, Waiter::take_value_of(node));
                    }
                    hand_off_slots.occupy(Side::Sender);
                    return HandOff::Waits;
                }
            }
        }
        self.wait_point.clear_slots(&mut lists);
        HandOff::No(ChannelGuard {
            channel: self,
            lists,
        })
    }

    /// Receives from the sender that waits on a hand-off slot, or waits on one. O(1).
    ///
    /// # Safety
    ///
    /// `node` is not listed, no other thread accesses it, and it holds no value. It stays where it
    /// is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn recv_by_slot(&self, node: NonNull<Waiter<T>>) -> HandOff<'_, T, T> {
        let hand_off_slots = &self.wait_point.hand_off_slots;
        let mut lists = self.wait_point.lock();
        // SAFETY: as above; a sender's node holds its value, and with room the hand-off slot does.
        unsafe {
            // Values given back by dropped receives come first.
            if lists.may_use_hand_off_slots() && !lists.is_storing {
                if hand_off_slots.is_waiting(Side::Sender)
                    && let Some(sender) = lists.hand_off.get(Side::Sender)
                {
                    lists.receiver = LastUser::of(current::user());
                    let wait_point = &self.wait_point;
                    wait_point.report(|| [user_number(sender), events::current_process()]);
                    let value = match has_room::<T>() {
                        true => hand_off_slots.take(Side::Sender),
                        false => Waiter::take_value_of(sender.cast()),
                    };
                    hand_off_slots.settle(Side::Sender);
                    return HandOff::Done(value);
                }
                if hand_off_slots.is_free(Side::Receiver) && spin::may_look() {
                    lists.receiver = LastUser::of(current::user());
                    Waiter::begin_in_slot(node);
                    lists.hand_off.note(Side::Receiver, node.cast());
                    hand_off_slots.occupy(Side::Receiver);
                    return HandOff::Waits;
                }
            }
        }
        self.wait_point.clear_slots(&mut lists);
        HandOff::No(ChannelGuard {
            channel: self,
            lists,
        })
    }

    /// Looks for the partner of an operation that waits on a hand-off slot; if none comes, or
    /// another operation has listed it, it waits in its list. Returns its result.
    ///
    /// # Safety
    ///
    /// The operation waits on the hand-off slot of this side, with this node, and this is its poll.
    #[inline]
    pub(crate) unsafe fn look_from_slot(
        &self,
        node: NonNull<Waiter<T>>,
        side: Side,
        cx: &Context<'_>,
    ) -> Outcome {
        let hand_off_slots = &self.wait_point.hand_off_slots;
        // The looking operation must leave the hand-off slot itself. A panic that would drop it on
        // the way (in the test for attention of its thread) ends the program.
        let stays = AbortOnDrop;
        spin::look(|| !hand_off_slots.is_waiting(side));
        std::mem::forget(stays);
        // SAFETY: the contract.
        unsafe {
            if hand_off_slots.is_done(side) {
                self.leave_done(node, side);
                return Outcome::Done;
            }
            self.leave_for_list(node, side, cx)
        }
    }

    /// # Safety
    ///
    /// As for [`look_from_slot`](Self::look_from_slot); and it is done.
    #[inline]
    unsafe fn leave_done(&self, node: NonNull<Waiter<T>>, side: Side) {
        let hand_off_slots = &self.wait_point.hand_off_slots;
        // SAFETY: by the contract; a finished operation is known to its future alone, and so is the
        // value in its hand-off slot.
        unsafe {
            if side == Side::Receiver && has_room::<T>() {
                Waiter::put_value_of(node, hand_off_slots.take(side));
            }
        }
        hand_off_slots.leave(side);
    }

    /// # Safety
    ///
    /// As for [`look_from_slot`](Self::look_from_slot).
    #[cold]
    unsafe fn leave_for_list(
        &self,
        node: NonNull<Waiter<T>>,
        side: Side,
        cx: &Context<'_>,
    ) -> Outcome {
        // Taking the lock lists an operation that still waits on a hand-off slot.
        let locked = self.lock();
        // SAFETY: by the contract; an unfinished operation was listed here.
        unsafe {
            if self.wait_point.hand_off_slots.is_done(side) {
                drop(locked);
                self.leave_done(node, side);
                return Outcome::Done;
            }
            self.wait_point.hand_off_slots.leave(side);
            let mut renewal = Renewal::of(cx);
            self.renew_wake_handle(Some(locked), node, &mut renewal)
        }
    }
}
