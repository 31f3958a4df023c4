//! Fast path of a buffer that lets its senders wait.
//!
//! The usual ways, a value stored and a value taken, are functions that call nothing but their
//! last step, so that they save no registers. Everything else has functions of its own.

use super::fast_path::leave_done;
use super::{Channel, FastPath};
use crate::wait_point::{LastUser, WaitPoint};
use crate::waiter::Waiter;
use core::hint::assert_unchecked;
use core::ptr::NonNull;
use luna_core::current::PlainTurn;

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
        // SAFETY: `channel` leads to a whole channel of values of this type, whose first field is
        // the wait point, and the operation's end keeps it; the node is one of this type: `Meet`
        // demands that.
        let (this, node) = unsafe { (channel.cast::<Self>().as_ref(), node.cast::<Waiter<T>>()) };
        // SAFETY: this thread has kept the lock, which guards the store too, and takes it back
        // once. A new send's node holds a value. The store of such a buffer was made with room for
        // all that the buffer holds, and one that is not full has room for one more.
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
    /// As for [`store_fast`](Self::store_fast): the lock was kept, and `node` is a new send's.
    #[inline(never)]
    unsafe fn wait_for_room(&self, node: NonNull<Waiter<T>>, turn: PlainTurn<'_>) -> FastPath {
        // SAFETY: this thread has kept the lock, and takes it back once. The new node is in no list
        // and known to its future alone, which withdraws it before it goes. The list of senders is
        // empty: at a channel with a buffer only a receiver waits alone, so that `list_lone` adds
        // none.
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
        // SAFETY: `channel` leads to a whole channel of values of this type, whose first field is
        // the wait point, and the operation's end keeps it; the node is one of this type: `Meet`
        // demands that.
        let (this, node) = unsafe { (channel.cast::<Self>().as_ref(), node.cast::<Waiter<T>>()) };
        // SAFETY: this thread has kept the lock, which guards the store too, and takes it back
        // once. A value is stored, so `pop_front` returns one. A new receive's node holds none, and
        // only its future knows it.
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
    /// As for [`take_stored_fast`](Self::take_stored_fast): the lock was kept, and `node` is a new
    /// receive's.
    #[inline(never)]
    unsafe fn take_stored_otherwise(
        &self,
        node: NonNull<Waiter<T>>,
        turn: PlainTurn<'_>,
    ) -> FastPath {
        // SAFETY: this thread has kept the lock by its bias, takes it back once, and the lock
        // guards the store too. The new node is known to its future alone, and holds no value. A
        // listed sender with a plain wake handle holds its value. It is settled after it was taken
        // off and its value moved. A value is stored, so `pop_front` returns one. The wake was made
        // in a plain turn on this thread.
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
