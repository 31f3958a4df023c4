//! Fast path of a buffer that lets its senders wait.
//!
//! The usual ways, a value stored and a value taken, are functions that call nothing but their
//! last step, so that they save no registers. Everything else has functions of its own.

use super::fast_path::leave_done;
use super::{Channel, FastPath};
use crate::wait_point::{LastUser, WaitPoint};
use crate::waiter::Waiter;
use luna_core::current::PlainTurn;
use std::hint::assert_unchecked;
use std::ptr::NonNull;

impl<T> Channel<T> {
    /// Stores the value of a sender, or lists the sender.
    ///
    /// # Safety
    ///
    /// As for [`Meet`](super::Meet), of a send at a channel with a buffer.
    pub(super) unsafe fn store_fast(
        channel: NonNull<WaitPoint>,
        node: NonNull<Waiter<()>>,
        turn: PlainTurn<'_>,
    ) -> FastPath {
        // SAFETY: the contract: the wait point is the first field of such a channel.
        let (this, node) = unsafe { (channel.cast::<Self>().as_ref(), node.cast::<Waiter<T>>()) };
        // SAFETY: the contract: the executor has kept the lock, which guards the store too, and the
        // node holds a value. The store of such a buffer was made with room for all that the buffer
        // holds, and one that is not full has room for one more.
        unsafe {
            let mut lists = this.wait_point.kept(turn);
            let is_stored = this.store.with_mut(|store| {
                let store = &mut *store;
                if store.len() >= this.capacity() {
                    return false;
                }
                assert_unchecked(store.len() < store.capacity());
                store.push_back(Waiter::take_value_of(node));
                true
            });
            if !is_stored {
                lists.keep();
                return this.wait_for_room(node, turn);
            }
            lists.note_user(true, LastUser::process(turn.process().id()));
            lists.is_storing = true;
            leave_done(&this.wait_point, lists, turn)
        }
    }

    /// Lists a sender that has found the buffer full.
    ///
    /// # Safety
    ///
    /// As for [`store_fast`](Self::store_fast).
    #[inline(never)]
    unsafe fn wait_for_room(&self, node: NonNull<Waiter<T>>, turn: PlainTurn<'_>) -> FastPath {
        // SAFETY: the contract: the executor has kept the lock.
        unsafe {
            let mut lists = self.wait_point.kept(turn);
            if !lists.senders.is_empty() {
                return FastPath::No;
            }
            lists.note_user(true, LastUser::process(turn.process().id()));
            lists.list_lone();
            Waiter::begin_plain(node, turn);
            lists.senders.insert_into_empty(node.cast());
            FastPath::Waits
        }
    }

    /// Receives a stored value, and a waiting sender moves up; or lets the receiver wait.
    ///
    /// # Safety
    ///
    /// As for [`Meet`](super::Meet), of a receive at a channel with a buffer.
    pub(super) unsafe fn take_stored_fast(
        channel: NonNull<WaitPoint>,
        node: NonNull<Waiter<()>>,
        turn: PlainTurn<'_>,
    ) -> FastPath {
        // SAFETY: the contract: the wait point is the first field of such a channel.
        let (this, node) = unsafe { (channel.cast::<Self>().as_ref(), node.cast::<Waiter<T>>()) };
        // SAFETY: the contract: the executor has kept the lock, which guards the store too.
        unsafe {
            let mut lists = this.wait_point.kept(turn);
            let stored = this.store.with(|store| (*store).len());
            // Values given back by dropped futures may exceed the capacity.
            if stored == 0 || stored > this.capacity() || !lists.senders.is_empty() {
                lists.keep();
                return this.take_stored_otherwise(node, turn);
            }
            let value = this.store.with_mut(|store| (*store).pop_front());
            Waiter::put_value_of(node, value.unwrap_unchecked());
            lists.note_user(false, LastUser::process(turn.process().id()));
            lists.is_storing = stored > 1;
            leave_done(&this.wait_point, lists, turn)
        }
    }

    /// As [`take_stored_fast`](Self::take_stored_fast), where nothing is stored or a sender waits.
    ///
    /// # Safety
    ///
    /// As there.
    #[inline(never)]
    unsafe fn take_stored_otherwise(
        &self,
        node: NonNull<Waiter<T>>,
        turn: PlainTurn<'_>,
    ) -> FastPath {
        // SAFETY: the contract: the executor has kept the lock, which guards the store too. A
        // listed sender's node holds its value.
        unsafe {
            let process = turn.process();
            let mut lists = self.wait_point.kept(turn);
            let stored = self.store.with(|store| (*store).len());
            let Some(first) = lists.senders.first() else {
                if stored != 0 || !lists.waiting.is_store() {
                    return FastPath::No;
                }
                lists.note_user(false, LastUser::process(process.id()));
                Waiter::begin_alone(node, turn);
                lists.set_alone(node.cast(), false);
                return FastPath::Waits;
            };
            // A sender whose closure panicked may have left room behind it.
            if stored == 0 || stored > self.capacity() {
                return FastPath::No;
            }
            let sender = first.cast::<Waiter<T>>();
            let Some(ready) = Waiter::take_plain_wake_handle(sender) else {
                return FastPath::No;
            };
            lists.note_user(false, LastUser::process(process.id()));
            lists.senders.remove_first(first);
            let next = Waiter::take_value_of(sender);
            let value = self.store.with_mut(|store| {
                let value = (*store).pop_front();
                (*store).push_back(next);
                value
            });
            Waiter::put_value_of(node, value.unwrap_unchecked());
            Waiter::settle_plain(sender);
            drop(lists);
            ready.wake();
            FastPath::done(turn)
        }
    }
}
