//! Where processes meet: the part of a channel or barrier that does not depend on the type of its
//! values.

mod queues;

pub(crate) use queues::{LastUser, WaitQueues, Waiting};

use crate::core::{HandOffSlots, Nodes};
use crate::inspect::Identity;
use crate::replay::{LogState, Order};
use crate::waiter::Waiter;
use core::hint::black_box;
use core::ops::DerefMut;
use core::ptr::NonNull;
use luna_core::biased_lock::{BiasedGuard, BiasedLock, InsideGuard};
use luna_core::current::{Here, PlainTurn, User};
use luna_core::events;
use luna_core::wait_list::{WaitList, WaitNode};
use luna_core::waiting::OpList;

/// Whether communication is still possible.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    Open,
    /// All senders are gone, or all receivers.
    Closed,
    Poisoned,
}

/// Moves a value from the node of a sender to that of a receiver, both of the channel's type. The
/// sender's node holds a value, the receiver's none, and no other thread accesses either.
pub(crate) type Mover = unsafe fn(NonNull<Waiter<()>>, NonNull<Waiter<()>>);

/// The waiter's number, for events; 0 if it is no process.
///
/// # Safety
///
/// The node is live, and guarded by a lock that is held.
#[inline(always)]
pub(crate) unsafe fn user_number(node: NonNull<WaitNode>) -> u64 {
    // SAFETY: the node is live, and a lock is held that guards it, as is demanded here, so no other
    // thread writes it. Other threads may access the other parts of the operation around it.
    match unsafe { node.as_ref() }.user() {
        User::Process(id) => id.get().into(),
        User::Outside => 0,
    }
}

/// The lists, under their lock, in whichever way it is held.
pub trait Lists: DerefMut<Target = WaitQueues> {}
impl<L: DerefMut<Target = WaitQueues>> Lists for L {}

/// Where processes meet. It must lie at the beginning of a cache line, so that a rendezvous writes
/// one line only.
#[derive(Debug)]
#[repr(C)]
pub(crate) struct WaitPoint {
    /// On one line with the lock.
    pub(crate) hand_off_slots: HandOffSlots,
    /// An operation that waits alone, or on a hand-off slot, is not in the lists: see the methods.
    pub(crate) lock: BiasedLock<WaitQueues>,
    pub(crate) identity: Identity,
}

// SAFETY: the queues are guarded by their lock, and the slots by their protocol: see
// `HandOffSlots`.
unsafe impl Sync for WaitPoint {}

impl WaitPoint {
    pub(crate) fn new(identity: Identity) -> Self {
        Self {
            hand_off_slots: HandOffSlots::new(),
            lock: BiasedLock::new(WaitQueues {
                waiting: Waiting::QUEUES,
                nothing: Waiting::IDLE,
                moves_word: false,
                hand_off: Nodes::NONE,
                senders: WaitList::new(),
                receivers: WaitList::new(),
                held: WaitList::new(),
                registered: WaitList::new(),
                watching: OpList::new(),
                ending: Ending::Open,
                is_unusual: false,
                is_plain: false,
                may_be_plain: false,
                extends: false,
                is_storing: false,
                tickets: 0,
                sender: LastUser::NONE,
                receiver: LastUser::NONE,
                server: None,
                log_state: LogState::default(),
                order: Order::default(),
            }),
            identity,
        }
    }

    /// Records that a value goes from one to the other; 0 is an unknown partner, such as a buffer.
    #[inline(always)]
    pub(crate) fn report(&self, communication: impl FnOnce() -> [u64; 2]) {
        if events::is_on() {
            let number = self.identity.number();
            events::report(events::code::COMMUNICATION, number, communication);
        }
    }

    /// Notes that `user` has used it: one from outside of the system may come again.
    #[inline(always)]
    pub(crate) fn note_outsider(&self, user: User) {
        if user == User::Outside {
            self.identity.set_external();
        }
    }

    /// Notes that the current process is about to wait here.
    #[inline(always)]
    pub(crate) fn waits(&self) {
        events::waits_for(|| (self.identity.kind_in_events(), self.identity.number()));
    }

    /// Notes that it does not wait after all: it gives up, or is done in the turn in which it was
    /// to wait.
    #[inline(always)]
    pub(crate) fn waits_no_more(&self) {
        if events::is_on() {
            self.take_note_back();
        }
    }

    #[cold]
    #[inline(never)]
    fn take_note_back(&self) {
        let here = || (self.identity.kind_in_events(), self.identity.number());
        events::waits_no_more(|| Some(here()));
    }

    /// Locks. An operation that waits on a hand-off slot is not in the lists. To see such
    /// operations of a channel too, use [`lock_lists`](Self::lock_lists).
    #[inline]
    pub(crate) fn lock(&self, here: Here<'_>) -> BiasedGuard<'_, WaitQueues> {
        let mut lists = self.lock.lock_in(here);
        lists.list_lone();
        lists
    }

    /// As [`lock`](Self::lock), where no operation ever waits alone: not of a channel.
    #[inline(always)]
    pub(crate) fn lock_in(&self, here: Here<'_>) -> BiasedGuard<'_, WaitQueues> {
        let lists = self.lock.lock_in(here);
        debug_assert!(lists.waiting == Waiting::QUEUES);
        lists
    }

    /// As [`lock_in`](Self::lock_in), if the lock is biased to this thread's executor.
    #[inline(always)]
    pub(crate) fn enter_in(&self, here: Here<'_>) -> Option<InsideGuard<'_, WaitQueues>> {
        self.lock.enter_in(here)
    }

    /// Locks, and lists the operation that waits on a hand-off slot: from there on all is as if
    /// there were no hand-off slots.
    #[inline]
    pub(crate) fn lock_lists(&self) -> BiasedGuard<'_, WaitQueues> {
        let mut lists = self.lock(Here::now());
        self.clear_slots(&mut lists);
        lists
    }

    /// Lists the operations that wait on the hand-off slots. O(1), since no other operation is
    /// listed then. `lists` are this wait point's.
    #[inline]
    pub(crate) fn clear_slots(&self, lists: &mut WaitQueues) {
        if self.hand_off_slots.is_anybody_waiting() {
            self.list_from_slots(lists);
        }
    }

    #[cold]
    fn list_from_slots(&self, lists: &mut WaitQueues) {
        for is_sender in [true, false] {
            if self.hand_off_slots.is_waiting(is_sender)
                && let Some(node) = lists.hand_off.get(is_sender)
            {
                let queue = lists.queue(is_sender);
                // SAFETY: an operation that waits on a hand-off slot has begun its node, which is
                // in no list and stays where it is; it looks until the slot says what has come of
                // that.
                unsafe { queue.insert_again(node) };
                self.hand_off_slots.say_listed(is_sender);
            }
        }
    }

    /// See [`BiasedLock::after_revocation`].
    pub(crate) fn after_revocation(&self) {
        self.lock.after_revocation();
    }

    /// As [`after_revocation`](Self::after_revocation), for a caller that ends by this call.
    #[cold]
    #[inline(never)]
    pub(crate) fn revoked<R>(&self, result: R) -> R {
        self.after_revocation();
        // Not to be seen through: a known result would be set after a call, which then is no tail
        // call.
        black_box(result)
    }

    /// The guard that was kept: see [`BiasedLock::kept`].
    ///
    /// # Safety
    ///
    /// The calling thread has kept a guard of this lock, and has not called this since.
    #[inline(always)]
    pub(crate) unsafe fn kept(&self, turn: PlainTurn<'_>) -> InsideGuard<'_, WaitQueues> {
        // SAFETY: this thread has kept a guard, and takes it back once, as is demanded here: all
        // that the lock demands.
        unsafe { self.lock.kept(turn) }
    }

    /// Locks for an occasional look: see [`BiasedLock::lock_briefly`].
    pub(crate) fn lock_briefly(&self) -> BiasedGuard<'_, WaitQueues> {
        let mut lists = self.lock.lock_briefly();
        lists.list_lone();
        lists
    }
}

#[cfg(all(
    test,
    feature = "std",
    not(loom),
    target_os = "linux",
    target_pointer_width = "64"
))]
mod tests {
    use super::*;
    use core::mem::offset_of;

    /// Bounds the memory of a channel: with five lists of two words, and no packed fields, it was
    /// half as much again.
    #[test]
    fn a_channel_takes_five_cache_lines_of_which_a_rendezvous_needs_two() {
        assert!(
            size_of::<crate::core::Channel<u64>>() <= 320,
            "{}",
            size_of::<crate::core::Channel<u64>>()
        );
        let behind = size_of::<WaitQueues>() - offset_of!(WaitQueues, tickets);
        assert!(offset_of!(WaitPoint, lock) + size_of::<BiasedLock<WaitQueues>>() - behind <= 128);
    }
}
