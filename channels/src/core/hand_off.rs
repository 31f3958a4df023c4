//! Where two operations that are awake at the same time meet without a queue: on the cache line of
//! the lock.
//!
//! An operation that looks for its partner for a while, before its process waits, is awake all that
//! time. Its partner then need not wake its process, nor access its node if the value has
//! [room](has_room) in the slot: it is exchanged beside the lock, on a line that the partner has
//! fetched anyway. Between two cores each line is a transfer of its own, and they come one after
//! the other.
//!
//! There is a hand-off slot for each side. So the sender may offer its next value while its
//! receiver has not fetched the one before.
//!
//! ```text
//!   FREE ------> WAITING ------> DONE ----> FREE      by the operation, the partner, the operation
//!                   '----------> LISTED --> FREE      by another operation, the first operation
//!
//!   Each step but the last one is made under the lock.
//! ```
//!
//! Hand-off slots keep no order, so they are used only as long as there is nothing to order: one
//! operation waits on a side, at a channel that is used for plain sends and receives only. Any
//! other operation (a second one of a side, an alternative, the end) first lists the operation that
//! waits on a slot, when it takes the lock
//! ([`WaitPoint::lock_lists`](crate::wait_point::WaitPoint::lock_lists)); from there on all is as
//! if there were no hand-off slots. The fast path does not look at them: the executor that owns the
//! bias is alone with the lock, and what waits on a hand-off slot is a poll of that thread which
//! has not come back.

use super::{Channel, Locked};
use crate::wait_point::{LastUser, user_number};
use crate::waiter::{Begun, Outcome, Waiter};
use core::mem::MaybeUninit;
use core::ptr::NonNull;
use core::task::Context;
use luna_core::current::Renewal;
use luna_core::wait_list::WaitNode;
use luna_core::{events, spin};
use luna_platform::sync::UnsafeCell;
use luna_platform::sync::atomic::{AtomicU8, Ordering};

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
        let (own, other) = (is_sender, !is_sender);
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
                (true, true) => slots.put(false, Waiter::take_value_of(node)),
                (true, false) => Waiter::put_value_of(partner, Waiter::take_value_of(node)),
                (false, true) => Waiter::put_value_of(node, slots.take(true)),
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
        let hand_off_slots = &self.wait_point.hand_off_slots;
        // The looking operation must leave the hand-off slot itself. A panic that would drop it on
        // the way (in the test for attention of its thread) ends the program.
        let stays = AbortOnDrop;
        spin::look(|| !hand_off_slots.is_waiting(is_sender));
        core::mem::forget(stays);
        // Taking the lock lists an operation that still waits on a hand-off slot.
        let locked = (!hand_off_slots.is_done(is_sender)).then(|| self.lock());
        let is_done = hand_off_slots.is_done(is_sender);
        // SAFETY: the operation waited on this slot with this node, and this is its poll, as is
        // demanded here. From `DONE` on the partner touches neither the node nor the slot: both are
        // this future's. A value with room that it received lies in the slot, and none in its node.
        unsafe {
            if is_done && !is_sender && has_room::<T>() {
                Waiter::put_value_of(node, hand_off_slots.take(is_sender));
            }
        }
        hand_off_slots.leave(is_sender);
        if is_done {
            return Outcome::Done;
        }
        // SAFETY: it was listed, here or by another operation, and not withdrawn; `locked` is this
        // channel's.
        unsafe { self.renew_wake_handle(locked, node, Renewal::of(cx)) }
    }
}

mod state {
    /// No operation is there.
    pub(super) const FREE: u8 = 0;
    /// An operation looks for its partner on it. Changed under the lock alone.
    pub(super) const WAITING: u8 = 1;
    /// Its partner has come.
    pub(super) const DONE: u8 = 2;
    /// The waiting operation is in its list.
    pub(super) const LISTED: u8 = 4;
}

/// The node of the present or last waiter on each hand-off slot. Guarded by the wait point's lock,
/// and on another line than the slots: it rarely changes, and is then only read.
#[derive(Debug)]
pub(crate) struct Nodes([Option<NonNull<WaitNode>>; 2]);

// SAFETY: it owns no node; the lock that guards it guards the nodes too, so it may go where the
// lock goes.
unsafe impl Send for Nodes {}

impl Nodes {
    pub(crate) const NONE: Nodes = Nodes([None; 2]);

    /// The waiter's node: valid while its hand-off slot is waited on.
    #[inline]
    pub(crate) fn get(&self, is_sender: bool) -> Option<NonNull<WaitNode>> {
        self.0[usize::from(is_sender)]
    }

    /// Stores the waiter's node, if it is another one than before.
    #[inline]
    pub(crate) fn note(&mut self, is_sender: bool, node: NonNull<WaitNode>) {
        if self.get(is_sender) != Some(node) {
            self.0[usize::from(is_sender)] = Some(node);
        }
    }
}

/// Room for a value of each side: the rest of the line.
type Room = MaybeUninit<u64>;

/// Whether values of this type fit in a hand-off slot. Others are exchanged in the nodes.
pub(crate) const fn has_room<T>() -> bool {
    size_of::<T>() <= size_of::<Room>() && align_of::<T>() <= align_of::<Room>()
}

/// A hand-off slot for each side.
///
/// # Invariants
///
/// A state is changed from `FREE` and from `WAITING` by the thread that holds the wait point's
/// lock, and from the others by the waiter. A sender's value is valid while it is `WAITING` on it,
/// a receiver's from when it is `DONE`, each for values that have [room](has_room). It is accessed
/// by the thread that may change the state.
#[derive(Debug)]
#[repr(C)]
pub(crate) struct HandOffSlots {
    states: [AtomicU8; 2],
    values: [UnsafeCell<Room>; 2],
}

impl HandOffSlots {
    pub(crate) fn new() -> Self {
        Self {
            states: [state::FREE, state::FREE].map(AtomicU8::new),
            values: core::array::from_fn(|_| UnsafeCell::new(MaybeUninit::uninit())),
        }
    }

    #[inline]
    fn load(&self, is_sender: bool) -> u8 {
        // Acquire: a thread that sees `DONE` sees the value that came with it.
        self.states[usize::from(is_sender)].load(Ordering::Acquire)
    }

    #[inline]
    fn store(&self, is_sender: bool, state: u8) {
        // Release: as for `load`.
        self.states[usize::from(is_sender)].store(state, Ordering::Release);
    }

    /// Whether an operation waits on this side. Exact under the lock.
    #[inline]
    pub(crate) fn is_waiting(&self, is_sender: bool) -> bool {
        self.load(is_sender) == state::WAITING
    }

    /// Whether an operation waits on either side. Exact under the lock.
    #[inline]
    pub(crate) fn is_anybody_waiting(&self) -> bool {
        // Both in one word, since nearly every slow-path operation asks this: only `WAITING` has
        // its bit.
        let states = self.load(true) | self.load(false);
        states & state::WAITING != 0
    }

    /// Whether an operation can come to wait on this side. Under the lock.
    #[inline]
    pub(crate) fn is_free(&self, is_sender: bool) -> bool {
        self.load(is_sender) == state::FREE
    }

    /// The calling operation waits from now on. Under the lock, on a hand-off slot that is free.
    #[inline]
    pub(crate) fn occupy(&self, is_sender: bool) {
        self.store(is_sender, state::WAITING);
    }

    /// The waiter on this side has met its partner. Under the lock.
    #[inline]
    pub(crate) fn settle(&self, is_sender: bool) {
        self.store(is_sender, state::DONE);
    }

    /// The waiter on this side was listed. Under the lock.
    pub(crate) fn say_listed(&self, is_sender: bool) {
        self.store(is_sender, state::LISTED);
    }

    /// Called by the waiter on this side: whether its partner has come.
    #[inline]
    pub(crate) fn is_done(&self, is_sender: bool) -> bool {
        self.load(is_sender) == state::DONE
    }

    /// The waiter on this side leaves: it is done or was listed.
    #[inline]
    pub(crate) fn leave(&self, is_sender: bool) {
        self.store(is_sender, state::FREE);
    }

    /// Puts a value there.
    ///
    /// # Safety
    ///
    /// By the type's invariants the caller may access the value, and it has [room](has_room).
    #[inline]
    pub(crate) unsafe fn put<T>(&self, is_sender: bool, value: T) {
        const { assert!(!has_room::<T>() || align_of::<Room>() >= align_of::<T>()) };
        // SAFETY: the value has room in the slot. By the type's invariants this thread alone
        // accesses the slot's value: it may change the state.
        self.values[usize::from(is_sender)]
            .with_mut(|room| unsafe { room.cast::<T>().write(value) });
    }

    /// Moves the value out.
    ///
    /// # Safety
    ///
    /// As for [`put`](Self::put); and a value of this type was put there, and was not taken since.
    #[inline]
    pub(crate) unsafe fn take<T>(&self, is_sender: bool) -> T {
        // SAFETY: a value of this type lies there, and is read once. By the type's invariants this
        // thread alone accesses it: it may change the state.
        self.values[usize::from(is_sender)].with(|room| unsafe { room.cast::<T>().read() })
    }
}
