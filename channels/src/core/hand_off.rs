//! Hand-off between two operations that are awake at the same time, on different threads: see
//! [`hand_off_slots`](crate::hand_off_slots).

use super::{Channel, Locked};
use crate::hand_off_slots::{Side, has_room};
use crate::wait_point::{LastUser, user_number};
use crate::waiter::{Begun, Outcome, Waiter};
use core::ptr::NonNull;
use core::task::Context;
use luna_core::current::Renewal;
use luna_core::events;
use luna_core::spin;

/// Result of an operation at the hand-off slots.
pub(crate) enum HandOff {
    /// It is done. There is no process to wake.
    Done,
    /// It waits on its hand-off slot, and is to [look](Channel::look_from_slot).
    Waits,
    /// Nothing has happened, and no operation waits on a hand-off slot.
    No,
}

/// Ends the program if it is dropped.
struct AbortOnDrop;

impl Drop for AbortOnDrop {
    fn drop(&mut self) {
        luna_platform::panics::abort();
    }
}

impl<T> Locked<'_, T> {
    /// Meets the partner that waits on a hand-off slot, or waits on one; or lists what waits on
    /// them. O(1).
    ///
    /// # Safety
    ///
    /// `node` is a plain operation's and not listed. No other thread accesses it. A send's holds
    /// its value, a receive's none. It stays where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn meet_at_slot(
        &mut self,
        is_sender: bool,
        node: NonNull<Waiter<T>>,
    ) -> HandOff {
        let (own, other) = (Side::of(is_sender), Side::of(!is_sender));
        let wait_point = &self.channel.wait_point;
        let slots = &wait_point.hand_off_slots;
        let lists = &mut *self.lists;
        // For a receive, values given back by dropped receives come first.
        if lists.may_use_hand_off_slots() && (is_sender || !lists.is_storing) {
            if slots.is_waiting(other)
                && let Some(partner) = lists.hand_off.get(other)
            {
                lists.note_user(is_sender, LastUser::of(self.here.user()));
                wait_point.report(|| {
                    // SAFETY: a node on a slot is live, and the lock is held.
                    let partner = unsafe { user_number(partner) };
                    let users = [events::current_process(), partner];
                    if is_sender {
                        users
                    } else {
                        [users[1], users[0]]
                    }
                });
                // SAFETY: a new send's node holds its value, a new receive's none. A waiting
                // receiver's node holds no value, and its future looks at the slot alone. A waiting
                // sender's value lies in the slot if that has room, else in its node. The lock is
                // held.
                unsafe {
                    self.channel.move_by_slot(is_sender, node, partner.cast());
                };
                slots.settle(other);
                return HandOff::Done;
            }
            if slots.is_free(own) && spin::may_look() {
                lists.note_user(is_sender, LastUser::of(self.here.user()));
                // SAFETY: the new node is in no list and only its future knows it; it stays until
                // it is settled or withdrawn. The slot is free and the lock is held, so this thread
                // may put a value there: a bitwise copy of a sender's. One of the two is used: the
                // slot's if it is met there, the node's once that is listed.
                unsafe {
                    Waiter::begin_as(node, (self.here, None), Begun::InFull, None, None);
                    lists.hand_off.note(own, node.cast());
                    if is_sender && has_room::<T>() {
                        slots.put(own, Waiter::take_value_of(node));
                    }
                }
                slots.occupy(own);
                return HandOff::Waits;
            }
        }
        self.list_from_slots();
        HandOff::No
    }
}

impl<T> Channel<T> {
    /// Moves the value between an operation and its partner on a hand-off slot.
    ///
    /// # Safety
    ///
    /// The lock is held. `node` is new, and `partner` waits on the hand-off slot of the other side.
    /// One of them, or its slot, holds a value for the other.
    #[inline(always)]
    unsafe fn move_by_slot(
        &self,
        is_sender: bool,
        node: NonNull<Waiter<T>>,
        partner: NonNull<Waiter<T>>,
    ) {
        let slots = &self.wait_point.hand_off_slots;
        // SAFETY: the lock is held, so no other thread accesses a node or slot of an operation that
        // waits, and the value can be moved; one side holds a value for the other, as is demanded
        // here. One with room lies in the slot of the operation that waited, any other in its node.
        unsafe {
            match (is_sender, has_room::<T>()) {
                (true, true) => slots.put(Side::Receiver, Waiter::take_value_of(node)),
                (true, false) => Waiter::put_value_of(partner, Waiter::take_value_of(node)),
                (false, true) => Waiter::put_value_of(node, slots.take(Side::Sender)),
                (false, false) => Waiter::put_value_of(node, Waiter::take_value_of(partner)),
            }
        }
    }

    /// Looks for the partner of an operation that waits on a hand-off slot; if none comes, or
    /// another operation has listed it, it waits in its list. Returns its result.
    ///
    /// # Safety
    ///
    /// The operation waits on the hand-off slot of its side, with this node, and this is its poll.
    #[inline]
    pub(crate) unsafe fn look_from_slot(
        &self,
        node: NonNull<Waiter<T>>,
        is_sender: bool,
        cx: &Context<'_>,
    ) -> Outcome {
        let side = Side::of(is_sender);
        let hand_off_slots = &self.wait_point.hand_off_slots;
        // The looking operation must leave the hand-off slot itself. A panic that would drop it on
        // the way (in the test for attention of its thread) ends the program.
        let stays = AbortOnDrop;
        spin::look(|| !hand_off_slots.is_waiting(side));
        core::mem::forget(stays);
        // Taking the lock lists an operation that still waits on a hand-off slot.
        let locked = (!hand_off_slots.is_done(side)).then(|| self.lock());
        let is_done = hand_off_slots.is_done(side);
        // SAFETY: the operation waited on this slot with this node, and this is its poll, as is
        // demanded here. From `DONE` on the partner touches neither the node nor the slot: both are
        // this future's. A value with room that it received lies in the slot, and none in its node.
        unsafe {
            if is_done && side == Side::Receiver && has_room::<T>() {
                Waiter::put_value_of(node, hand_off_slots.take(side));
            }
        }
        hand_off_slots.leave(side);
        if is_done {
            return Outcome::Done;
        }
        // SAFETY: it was listed, here or by another operation, and not withdrawn; `locked` is this
        // channel's.
        unsafe { self.renew_wake_handle(locked, node, Renewal::of(cx)) }
    }
}
