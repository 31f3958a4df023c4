//! How a node is prepared for being listed.

use super::{Begun, Link, Make, Outcome, Seldom, Waiter};
use crate::select_state::SelectState;
use core::mem::MaybeUninit;
use core::ptr::NonNull;
use luna_core::current::{Here, PlainTurn, User, WakeHandle};
use luna_core::wait_list::WaitNode;
use luna_platform::sync::atomic::AtomicU8;

/// What waits: the process in its plain turn, or anything else, with a handle that was made before
/// the lock, or without one.
pub(crate) trait Waits {
    fn into_node(self) -> WaitNode;
}

impl Waits for PlainTurn<'_> {
    #[inline(always)]
    fn into_node(self) -> WaitNode {
        let process = self.process();
        let user = User::Process(process.id());
        let wake_handle = WakeHandle::of_plain_turn(self);
        WaitNode::waiting(user, process.priority(), Some(wake_handle))
    }
}

/// The wake handle of anything else.
impl<H: Into<Option<WakeHandle>>> Waits for (Here<'_>, H) {
    #[inline]
    fn into_node(self) -> WaitNode {
        let (here, wake_handle) = self;
        WaitNode::waiting(here.user(), here.priority(), wake_handle.into())
    }
}

impl Waits for WaitNode {
    #[inline(always)]
    fn into_node(self) -> WaitNode {
        self
    }
}

impl<T> Waiter<T> {
    /// As [`begin_as`](Self::begin_as), of one that is yet to be given a user and a priority.
    ///
    /// # Safety
    ///
    /// As for `begin_as`.
    pub(crate) unsafe fn begin(
        node: NonNull<Waiter<T>>,
        select_state: Option<(NonNull<SelectState>, u32)>,
    ) {
        // SAFETY: as is demanded here.
        unsafe { Self::begin_as(node, WaitNode::new(), Begun::InFull, select_state, None) };
    }

    /// Prepares a node for being listed.
    ///
    /// # Safety
    ///
    /// `node` is live, no other thread accesses it, and if this is not the first call, it is listed
    /// nowhere.
    #[inline(always)]
    pub(crate) unsafe fn begin_as(
        node: NonNull<Waiter<T>>,
        waits: impl Waits,
        begun: Begun,
        select_state: Option<(NonNull<SelectState>, u32)>,
        make: Option<Make<T>>,
    ) {
        let wait = waits.into_node();
        // SAFETY: the node is live, in no list, and no other thread accesses it, as is demanded
        // here: so it may be written as a whole. A settled node holds no wake handle, so nothing is
        // lost of a former link.
        unsafe {
            (*node.as_ptr()).link.write(Link {
                begun,
                ..Link::in_full(wait, select_state)
            });
            (*node.as_ptr()).seldom = Seldom {
                order: MaybeUninit::new(0),
                make: MaybeUninit::new(make),
            };
        }
    }

    /// Prepares the node of an operation that waits for itself alone, with all its fields, for
    /// being [listed](luna_core::wait_list::WaitList::insert_again).
    ///
    /// # Safety
    ///
    /// As for [`begin`](Self::begin): `node` is live, no other thread accesses it, and it is in no
    /// list.
    #[inline(always)]
    pub(crate) unsafe fn begin_for(node: NonNull<Waiter<T>>, waits: impl Waits, ticket: u32) {
        // SAFETY: the node is live, in no list, and no other thread accesses it, as is demanded
        // here; from `begin` on its link is there.
        unsafe {
            Self::begin_as(node, waits, Begun::InFull, None, None);
            (*Self::link(node)).ticket = ticket;
        }
    }

    /// Prepares a plain operation's node for being listed where no other node is, for the process
    /// in its plain turn.
    ///
    /// # Safety
    ///
    /// As for [`begin`](Self::begin): `node` is live, no other thread accesses it, and it is in no
    /// list.
    #[inline(always)]
    pub(crate) unsafe fn begin_plain(node: NonNull<Waiter<T>>, turn: PlainTurn<'_>) {
        let wait = turn.into_node();
        // SAFETY: the node is live, in no list, and no other thread accesses it, so its link may be
        // written. A settled node holds no wake handle, so nothing is lost of a former link.
        unsafe {
            (*node.as_ptr()).link.write(Link {
                begun: Begun::Plainly,
                ..Link::in_full(wait, None)
            });
        }
    }

    /// Prepares a plain operation's node for waiting alone, for the process in its plain turn: see
    /// [`Waiting`](crate::wait_point::Waiting).
    ///
    /// # Safety
    ///
    /// As for [`begin`](Self::begin): `node` is live, no other thread accesses it, and it is in no
    /// list.
    #[inline(always)]
    pub(crate) unsafe fn begin_alone(node: NonNull<Waiter<T>>, turn: PlainTurn<'_>) {
        // SAFETY: the node is live, in no list, and no other thread accesses it: its link is room
        // for what `wait_alone` writes, and its other fields may be written. Nothing of it is read.
        unsafe {
            let link = Self::link(node);
            WaitNode::wait_alone(&raw mut (*link).wait, turn);
            (&raw mut (*link).outcome).write(AtomicU8::new(Outcome::Waiting as u8));
            (&raw mut (*link).begun).write(Begun::Plainly);
        }
    }

    /// Prepares the node of a plain operation that is guard `number` of an alternative for waiting
    /// alone. The type of the value does not matter.
    ///
    /// # Safety
    ///
    /// As for [`begin`](Self::begin): `node` is live, no other thread accesses it, and it is in no
    /// list.
    #[inline(always)]
    pub(crate) unsafe fn begin_guard_alone(
        node: NonNull<Waiter<T>>,
        select_state: NonNull<SelectState>,
        number: u32,
    ) {
        // SAFETY: the node is live, in no list, and no other thread accesses it, so its fields may
        // be written. Nothing of it is read.
        unsafe {
            let link = Self::link(node);
            (&raw mut (*link).outcome).write(AtomicU8::new(Outcome::Waiting as u8));
            (&raw mut (*link).begun).write(Begun::AsGuard);
            (*link).select_state.write(Some((select_state, number)));
        }
    }

    /// Writes the other fields of a guard that was begun to wait alone, so that it can be listed.
    ///
    /// # Safety
    ///
    /// The node was begun by [`begin_guard_alone`](Self::begin_guard_alone) and is not settled; the
    /// lock is held that guards it.
    pub(crate) unsafe fn complete_guard(node: NonNull<Waiter<T>>) {
        // SAFETY: the node was begun as a guard, so its select state was written; a select state
        // outlives the wait of its guards. The lock is held and the node is not settled: no other
        // thread accesses the rest.
        unsafe {
            let (user, priority) = Self::guard_of(node).0.as_ref().opened_by();
            let wait = WaitNode::waiting(user, priority, None);
            (&raw mut (*Self::link(node)).wait).write(wait);
        }
    }
}
