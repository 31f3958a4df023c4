//! Where two who are awake at the same time meet without a node: on the line of memory that the lock lies on.
//!
//! An operation that looks for its partner for a while, before its process waits, is awake all that time. Its partner need not reach for its node then,
//! nor wake anybody: what they exchange lies beside the lock, which the partner has fetched anyway. Between two cores each line is a transfer of its own, and
//! they come one after the other.
//!
//! There is a hand_off_slot for each side. The sender may so offer its next value while its receiver has not fetched the one before.
//!
//! ```text
//!   FREE --an operation that may look, under the lock--> WAITING --partner, under the lock--> DONE --who waited--> FREE
//!                                                          '--anybody else, under the lock--> LISTED --who waited--> FREE
//! ```
//!
//! On the hand_off_slots nobody is ordered, so they are used only as long as there is nobody to order: one who waits on a side, at a channel of which nothing is asked
//! but to send and to receive. Whoever comes for anything else (a second one of a side, an alternative, the end) lists who waits there first, when it
//! takes the lock ([`WaitPoint::lock_lists`](crate::wait_point::Place::lock_lists)); from there on all is as if there were no hand_off_slots. The short way at home does not look at
//! them: the home that a lock favours is alone with it, and what waits on a hand_off_slot is a poll of that thread which has not come back.

use luna_core::wait_list::WaitNode;
use luna_platform::sync::UnsafeCell;
use luna_platform::sync::atomic::{AtomicU8, Ordering};
use std::mem::MaybeUninit;
use std::ptr::NonNull;

/// Who meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    Sender,
    Receiver,
}

mod state {
    /// Nobody is there.
    pub(super) const FREE: u8 = 0;
    /// Somebody looks at it. Changed under the lock alone.
    pub(super) const WAITING: u8 = 1;
    /// Its partner has come.
    pub(super) const DONE: u8 = 2;
    /// Who waits is in its list.
    pub(super) const LISTED: u8 = 4;
}

/// Whose node waits on each hand_off_slot, or did last. Guarded by the place's lock, and on another line than the hand_off_slots: it is mostly the same, and then read alone.
#[derive(Debug)]
pub(crate) struct Nodes([Option<NonNull<WaitNode>>; 2]);

// SAFETY: it owns no node; the lock that guards it guards the nodes too, so it may go where the lock goes.
unsafe impl Send for Nodes {}

impl Nodes {
    pub(crate) const NONE: Nodes = Nodes([None; 2]);

    /// Whose node it is: valid while its hand_off_slot is waited on.
    #[inline]
    pub(crate) fn get(&self, side: Side) -> Option<NonNull<WaitNode>> {
        self.0[side as usize]
    }

    /// Notes whose node it is, if it is another one than before.
    #[inline]
    pub(crate) fn note(&mut self, side: Side, node: NonNull<WaitNode>) {
        if self.get(side) != Some(node) {
            self.0[side as usize] = Some(node);
        }
    }
}

/// Room for a value: what is left of the line, for each side.
type Room = MaybeUninit<u64>;

/// Whether values of this type have room on a hand_off_slot. Others are exchanged in the nodes.
pub(crate) const fn has_room<T>() -> bool {
    size_of::<T>() <= size_of::<Room>() && align_of::<T>() <= align_of::<Room>()
}

/// A hand_off_slot for each side.
///
/// # Invariants
///
/// A state is changed from `FREE` and from `WAITING` by who holds the place's lock, and from the others by who waits. A sender's value is valid while it is `WAITING` on it, a
/// receiver's from when it is `DONE`, each for values that have [room](has_room). It is accessed by who may change the state.
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
            values: std::array::from_fn(|_| UnsafeCell::new(MaybeUninit::uninit())),
        }
    }

    #[inline]
    fn load(&self, side: Side) -> u8 {
        // Acquire: who sees that something was done sees what came with it.
        self.states[side as usize].load(Ordering::Acquire)
    }

    #[inline]
    fn store(&self, side: Side, state: u8) {
        // Release: as for `load`.
        self.states[side as usize].store(state, Ordering::Release);
    }

    /// Whether somebody waits on this side. Exact under the lock.
    #[inline]
    pub(crate) fn is_waiting(&self, side: Side) -> bool {
        self.load(side) == state::WAITING
    }

    /// Whether somebody waits. Exact under the lock.
    #[inline]
    pub(crate) fn is_anybody_waiting(&self) -> bool {
        // In one, since nearly every general operation asks this: `WAITING` alone has its bit.
        let states = self.load(Side::Sender) | self.load(Side::Receiver);
        states & state::WAITING != 0
    }

    /// Whether somebody can come to wait on this side. Under the lock.
    #[inline]
    pub(crate) fn is_free(&self, side: Side) -> bool {
        self.load(side) == state::FREE
    }

    /// The calling operation waits from now on. Under the lock, on a hand_off_slot that is free.
    #[inline]
    pub(crate) fn occupy(&self, side: Side) {
        self.store(side, state::WAITING);
    }

    /// Who waits on this side has met its partner. Under the lock.
    #[inline]
    pub(crate) fn settle(&self, side: Side) {
        self.store(side, state::DONE);
    }

    /// Who waits on this side was listed. Under the lock.
    pub(crate) fn say_listed(&self, side: Side) {
        self.store(side, state::LISTED);
    }

    /// For who waits on this side: whether its partner has come.
    #[inline]
    pub(crate) fn is_done(&self, side: Side) -> bool {
        self.load(side) == state::DONE
    }

    /// Who waited on this side leaves: it is done or was listed.
    #[inline]
    pub(crate) fn leave(&self, side: Side) {
        self.store(side, state::FREE);
    }

    /// Puts a value there.
    ///
    /// # Safety
    ///
    /// The caller may, by the type's invariants, and the value has [room](has_room).
    #[inline]
    pub(crate) unsafe fn put<T>(&self, side: Side, value: T) {
        const { assert!(!has_room::<T>() || align_of::<Room>() >= align_of::<T>()) };
        // SAFETY: the contract.
        self.values[side as usize].with_mut(|room| unsafe { room.cast::<T>().write(value) });
    }

    /// Moves the value out.
    ///
    /// # Safety
    ///
    /// As for [`put`](Self::put); and a value of this type was put there.
    #[inline]
    pub(crate) unsafe fn take<T>(&self, side: Side) -> T {
        // SAFETY: the contract.
        self.values[side as usize].with(|room| unsafe { room.cast::<T>().read() })
    }
}
