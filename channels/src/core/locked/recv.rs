//! A receive under the lock.

use super::{Attempted, ChannelGuard};
use crate::buffer::WhenFull;
use crate::core::Ending;
use crate::replay::{self, Stamped};
use crate::wait_point::{LastUser, WaitQueues};
use crate::waiter::Waiter;
use alloc::vec::Vec;
use core::hint::cold_path;
use core::ops::DerefMut;
use core::ptr::NonNull;
use luna_core::current::PendingWake;
use luna_core::events;

impl<T, L: DerefMut<Target = WaitQueues>> ChannelGuard<'_, T, L> {
    /// Receives into `node` at once, if possible. O(1).
    ///
    /// # Safety
    ///
    /// `node` is in no queue: it is new, or the entry of a registered alternative with a closed
    /// select state. No other thread accesses its value, and it holds none.
    #[inline]
    pub(crate) unsafe fn recv_now(
        &mut self,
        node: NonNull<Waiter<T>>,
        extended: bool,
    ) -> Attempted {
        self.lists.receiver = LastUser::of(self.here.user());
        if self.lists.is_unusual {
            cold_path();
            if self.lists.ending == Ending::Poisoned {
                return Attempted::Ended(Ending::Poisoned);
            }
            self.lists.note_partner();
        }
        // SAFETY: the node holds no value, and no other thread accesses that, as is demanded here.
        // It still holds none where nothing was stored, so the second call may follow.
        let attempted = unsafe {
            match self.take_stored(node) {
                Some(ready) => Attempted::Done(ready),
                None => self.take_waiting_sender(Some(node), extended),
            }
        };
        if extended {
            let ticket = match attempted {
                Attempted::Holds(_) => self.lists.tickets,
                _ => 0,
            };
            // SAFETY: the node is live, and until it is listed only its future reads this field. It
            // may be written whether the node was begun or not.
            unsafe { (*Waiter::link(node)).ticket = ticket };
        }
        match attempted {
            Attempted::NotNow if self.lists.ending == Ending::Closed => {
                Attempted::Ended(Ending::Closed)
            }
            attempted => attempted,
        }
    }

    /// Moves the first stored value into the node; a waiting sender, which is to be woken, moves
    /// up.
    ///
    /// # Safety
    ///
    /// As for [`recv_now`](Self::recv_now): `node` holds no value, and no other thread accesses
    /// that.
    #[inline]
    pub(super) unsafe fn take_stored(&mut self, node: NonNull<Waiter<T>>) -> Option<PendingWake> {
        let capacity = self.channel.capacity();
        let left = self.with_store(|store| {
            // SAFETY: the node holds no value, and no other thread accesses that, as is demanded
            // here.
            unsafe { Waiter::put_value_of(node, store.pop_front()?) };
            Some(store.len())
        })?;
        if self.lists.is_unusual {
            let stamp = self.lists.stamp(Stamped::Taking);
            if replay::is_replayed() {
                self.lists.note_taken(left + 1, stamp);
            }
        }
        let wait_point = &self.channel.wait_point;
        wait_point.report(|| [0, events::current_process()]);
        if left >= capacity {
            return Some(PendingWake::NONE);
        }
        // SAFETY: it goes into the store. If its value could not be made, the one taken here counts
        // as received all the same; the next receive finds the sender gone and the channel as it
        // is.
        Some(unsafe { self.take_waiting_sender(None, false) }.into_wake())
    }

    /// In a replay: takes out the values that the buffer had overwritten when the recorded receive
    /// with this stamp came.
    #[cold]
    pub(crate) fn take_overwritten(&mut self, stamp: u64) -> Vec<T> {
        let buffer = self.channel.buffer();
        if buffer.when_full == WhenFull::Wait {
            return Vec::new();
        }
        let stored = self.with_store(|store| store.len());
        let keeps_newest = buffer.when_full == WhenFull::DropOldest;
        let gone = self
            .lists
            .overwritten(stored, buffer.capacity, stamp, keeps_newest);
        self.with_store(|store| store.drain(gone).collect())
    }
}
