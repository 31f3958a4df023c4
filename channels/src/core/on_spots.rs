//! What two do who are awake at the same time, on different threads: see [`spots`](crate::spots).

use super::{Channel, Locked, ChannelGuard};
use crate::wait_point::{LastUser, user_number};
use crate::source::{Offered, Source};
use crate::spots::{Side, has_room};
use crate::waiter::{Outcome, Waiter};
use luna_core::current::{self, Renewal};
use luna_core::events;
use luna_core::spin;
use std::ptr::NonNull;
use std::task::Context;

/// What an operation has come to that has looked at the spots.
pub(crate) enum OnSpots<'a, T, R> {
    /// It is done. Nobody is to be readied.
    Done(R),
    /// It waits on its spot, and is to [look](Channel::look_from_spot).
    Waits,
    /// Nothing has happened. The lock is held, and nobody waits on a spot.
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
    /// Sends to who waits on a spot, or waits on one. O(1).
    ///
    /// # Safety
    ///
    /// `offered` is not listed, nobody else accesses it, and it holds or makes its value. It stays where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn send_on_spots<S: Source<T>>(
        &self,
        offered: NonNull<Offered<T, S>>,
    ) -> OnSpots<'_, T, ()> {
        let spots = &self.place.spots;
        let node = offered.cast::<Waiter<T>>();
        let mut lists = self.place.lock();
        // SAFETY: the contract: the value lies in the node, unless it is made. On a spot a receiver's node holds no value, and its future looks at the spot alone. The
        // lock is held.
        unsafe {
            if S::MAKE.is_none() && lists.may_meet_on_spots() {
                if spots.is_waiting(Side::Receiver)
                    && let Some(receiver) = lists.on_spots.get(Side::Receiver)
                {
                    lists.sender = LastUser::of(current::user());
                    let place = &self.place;
                    place.tell(|| [events::current_process(), user_number(receiver)]);
                    let value = Waiter::take_value_of(node);
                    if has_room::<T>() {
                        spots.put(Side::Receiver, value);
                    } else {
                        Waiter::put_value_of(receiver.cast(), value);
                    }
                    spots.settle(Side::Receiver);
                    return OnSpots::Done(());
                }
                if spots.is_free(Side::Sender) && spin::may_look() {
                    lists.sender = LastUser::of(current::user());
                    Waiter::begin_on_spot(node);
                    lists.on_spots.note(Side::Sender, node.cast());
                    if has_room::<T>() {
                        // It stays in the node too: where it is taken from, if the node is listed.
                        spots.put(Side::Sender, Waiter::take_value_of(node));
                    }
                    spots.occupy(Side::Sender);
                    return OnSpots::Waits;
                }
            }
        }
        self.place.clear_spots(&mut lists);
        OnSpots::No(ChannelGuard {
            channel: self,
            lists,
        })
    }

    /// Receives from who waits on a spot, or waits on one. O(1).
    ///
    /// # Safety
    ///
    /// `node` is not listed, nobody else accesses it, and it holds no value. It stays where it is until it is settled or withdrawn.
    #[inline]
    pub(crate) unsafe fn recv_on_spots(&self, node: NonNull<Waiter<T>>) -> OnSpots<'_, T, T> {
        let spots = &self.place.spots;
        let mut lists = self.place.lock();
        // SAFETY: as above; a sender's node holds its value, and with room the spot does.
        unsafe {
            // What came back from a receive that was dropped comes first.
            if lists.may_meet_on_spots() && !lists.is_storing {
                if spots.is_waiting(Side::Sender)
                    && let Some(sender) = lists.on_spots.get(Side::Sender)
                {
                    lists.receiver = LastUser::of(current::user());
                    let place = &self.place;
                    place.tell(|| [user_number(sender), events::current_process()]);
                    let value = match has_room::<T>() {
                        true => spots.take(Side::Sender),
                        false => Waiter::take_value_of(sender.cast()),
                    };
                    spots.settle(Side::Sender);
                    return OnSpots::Done(value);
                }
                if spots.is_free(Side::Receiver) && spin::may_look() {
                    lists.receiver = LastUser::of(current::user());
                    Waiter::begin_on_spot(node);
                    lists.on_spots.note(Side::Receiver, node.cast());
                    spots.occupy(Side::Receiver);
                    return OnSpots::Waits;
                }
            }
        }
        self.place.clear_spots(&mut lists);
        OnSpots::No(ChannelGuard {
            channel: self,
            lists,
        })
    }

    /// Looks for the partner of an operation that waits on a spot; if none comes, or somebody has listed it, it waits in its list. Says what it has come to.
    ///
    /// # Safety
    ///
    /// The operation waits on the spot of this side, with this node, and this is its poll.
    #[inline]
    pub(crate) unsafe fn look_from_spot(
        &self,
        node: NonNull<Waiter<T>>,
        side: Side,
        cx: &Context<'_>,
    ) -> Outcome {
        let spots = &self.place.spots;
        // Who looks must come to leave the spot: what would drop the operation on the way (a panic of who is asked whether the thread is called) ends the program.
        let stays = AbortOnDrop;
        spin::look(|| !spots.is_waiting(side));
        std::mem::forget(stays);
        // SAFETY: the contract.
        unsafe {
            if spots.is_done(side) {
                self.leave_done(node, side);
                return Outcome::Done;
            }
            self.leave_for_list(node, side, cx)
        }
    }

    /// # Safety
    ///
    /// As for [`look_from_spot`](Self::look_from_spot); and it is done.
    #[inline]
    unsafe fn leave_done(&self, node: NonNull<Waiter<T>>, side: Side) {
        let spots = &self.place.spots;
        // SAFETY: the contract; who is done is known to its future alone, and so is its spot's value.
        unsafe {
            if side == Side::Receiver && has_room::<T>() {
                Waiter::put_value_of(node, spots.take(side));
            }
        }
        spots.leave(side);
    }

    /// # Safety
    ///
    /// As for [`look_from_spot`](Self::look_from_spot).
    #[cold]
    unsafe fn leave_for_list(
        &self,
        node: NonNull<Waiter<T>>,
        side: Side,
        cx: &Context<'_>,
    ) -> Outcome {
        // Who still waits on a spot is listed by that.
        let section = self.lock();
        // SAFETY: the contract; who is not done was listed here.
        unsafe {
            if self.place.spots.is_done(side) {
                drop(section);
                self.leave_done(node, side);
                return Outcome::Done;
            }
            self.place.spots.leave(side);
            let mut renewal = Renewal::of(cx);
            self.renew_wakeup(Some(section), node, &mut renewal)
        }
    }
}
