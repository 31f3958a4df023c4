//! How a node is prepared for being listed; and how a partner takes a listed one: commits its
//! alternative, takes its wake handle, and settles its outcome.

use super::{Begun, Link, Make, Outcome, Seldom, Waiter};
use crate::select_state::SelectState;
use core::mem::MaybeUninit;
use core::ptr::NonNull;
use luna_core::current::{Here, PendingWake, PlainPendingWake, PlainTurn, User, WakeHandle};
use luna_core::wait_list::WaitNode;
use luna_platform::sync::atomic::{AtomicU8, Ordering};

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

/// Claims the select state of a node, and gives the node the wake handle.
///
/// # Safety
///
/// `node` begins a waiter, whatever the type of its values. It is listed, or was just taken off its
/// list, and the lock is held that guards it. The select state is its own.
#[cold]
pub(super) unsafe fn commit_select_state(
    node: NonNull<WaitNode>,
    select_state: NonNull<SelectState>,
    guard: u32,
) -> bool {
    // SAFETY: an owner takes the lock that is held here to withdraw the node, and does so before
    // its select state goes: so that is live. The lock guards the node's wake handle too.
    unsafe {
        match select_state.as_ref().commit(guard) {
            Some(wake_handle) => {
                *(*node.as_ptr()).wake_handle_mut() = Some(wake_handle);
                true
            }
            None => false,
        }
    }
}

impl<T> Waiter<T> {
    /// Takes the wake handle of an operation that was listed by [`begin_plain`](Self::begin_plain).
    /// The node is then to be unlisted and settled. `None` for another operation, with no state
    /// changed.
    ///
    /// # Safety
    ///
    /// `node` is listed. This thread is the executor that owns the bias of the lock that guards it,
    /// and holds that lock.
    #[inline(always)]
    pub(crate) unsafe fn take_plain_wake_handle(
        node: NonNull<Waiter<T>>,
    ) -> Option<PlainPendingWake> {
        // SAFETY: the node is listed, so its link was written, and the lock that is held guards it.
        // One begun plainly has the handle that the owner of the bias made in a plain turn. A lock
        // is biased to one executor in all its life: this one, so the handle was made on this
        // thread, as `take_plain` demands.
        unsafe {
            // Not a reference to the whole: its future may look at the outcome meanwhile.
            let link = Self::link(node);
            if (*link).begun == Begun::Plainly {
                WakeHandle::take_plain((*link).wait.wake_handle_mut())
            } else {
                None
            }
        }
    }

    /// Wakes the process of a listed operation and settles it as done, if that can be done under
    /// the lock: see [`WakeHandle::wake_here`]. The node is then to be unlisted, under the same
    /// lock. `false`: nothing has changed.
    ///
    /// # Safety
    ///
    /// `node` is listed and not settled, and the lock is held that guards it.
    #[inline(always)]
    pub(crate) unsafe fn wake_here(node: NonNull<Waiter<T>>, here: Here<'_>) -> bool {
        // SAFETY: the node is listed, so its link was written, and the lock that is held guards it.
        unsafe { WakeHandle::wake_here((*Self::link(node)).wait.wake_handle_mut(), here) }
    }

    /// The wake handle, to be changed: from here on it may differ from a plain operation's.
    ///
    /// # Safety
    ///
    /// `node` is listed, and the lock that guards it is held for as long as the result is used.
    pub(crate) unsafe fn change_wake_handle<'a>(
        node: NonNull<Waiter<T>>,
    ) -> &'a mut Option<WakeHandle> {
        // SAFETY: the node is listed, so its link was written, and the lock that is held guards it:
        // no other thread accesses these two fields while the reference lives.
        unsafe {
            let link = Self::link(node);
            if (*link).begun == Begun::Plainly {
                (*link).begun = Begun::PlainlyAndChanged;
            }
            (*link).wait.wake_handle_mut()
        }
    }

    /// Sets the outcome of an operation without a wake handle, or of one that waits on as `Held` or
    /// `Waiting`. A settled node is not to be touched after this, but by its own future.
    ///
    /// # Safety
    ///
    /// As for [`settle`](Self::settle); or its own future calls this, under the lock that guards
    /// the node. One that waits alone may still be noted in `waiting`, if the caller overwrites
    /// that before it releases the lock.
    #[inline(always)]
    pub(crate) unsafe fn set_outcome(node: NonNull<Waiter<T>>, outcome: Outcome) {
        // SAFETY: the node waits until this store, and its future needs the lock that is held here
        // to withdraw it: so it is live. Only the outcome is borrowed, which the future may load.
        // Release: the value and all that came before is visible to a thread that sees the outcome.
        unsafe {
            (*Self::link(node))
                .outcome
                .store(outcome as u8, Ordering::Release);
        }
    }

    /// Makes a plain operation that was not begun done: its value was moved.
    ///
    /// # Safety
    ///
    /// `node` is live, and no other thread accesses it.
    #[inline(always)]
    pub(crate) unsafe fn settle_new(node: NonNull<Waiter<T>>) {
        // SAFETY: the node is live, and no other thread accesses it, so the field may be written.
        unsafe {
            (&raw mut (*Self::link(node)).outcome).write(AtomicU8::new(Outcome::Done as u8));
        }
    }

    /// Claims the alternative of the node, if it has one. `false`: the alternative has chosen
    /// already. Otherwise the node is to be settled, and holds the alternative's wake handle.
    ///
    /// # Safety
    ///
    /// `node` is listed, or was just taken off its list, and the lock is held that guards it.
    #[inline(always)]
    pub(crate) unsafe fn commit(node: NonNull<Waiter<T>>) -> bool {
        // SAFETY: the node's lock is held, and it is or was listed under it: what `select_state`
        // and `commit_select_state` demand. A waiter begins with its wait node.
        unsafe {
            match Self::select_state(node) {
                None => true,
                Some((select_state, guard)) => {
                    commit_select_state(node.cast(), select_state, guard)
                }
            }
        }
    }

    /// Takes the wake handle out.
    ///
    /// # Safety
    ///
    /// `node` was listed and is not settled, and the lock is held that guards it.
    #[inline]
    pub(super) unsafe fn take_wake_handle(node: NonNull<Waiter<T>>) -> PendingWake {
        // SAFETY: a listed node's wake handle was written, and until the node is settled the lock
        // that is held guards it.
        unsafe {
            // loom does not watch the wake handle: to it, this is an access to the value beside it,
            // which must be over when the outcome is set.
            #[cfg(loom)]
            (*node.as_ptr()).value.with_mut(|_| ());
            (*Self::link(node))
                .wait
                .wake_handle_mut()
                .take()
                .map_or(PendingWake::NONE, WakeHandle::take)
        }
    }

    /// Settles a waiting operation that was just unlisted, and returns the process to wake. The
    /// node is not to be touched after this.
    ///
    /// # Safety
    ///
    /// `node` was listed, and is not settled. It was committed and taken off its list under the
    /// lock that is still held, or it is stale; and its state agrees with `outcome`. The entry of a
    /// registered alternative stays in its list.
    #[inline]
    pub(crate) unsafe fn settle(node: NonNull<Waiter<T>>, outcome: Outcome) -> PendingWake {
        // SAFETY: the future is pending until the store, and cannot go while the lock is held.
        unsafe {
            let ready = Self::take_wake_handle(node);
            Self::set_outcome(node, outcome);
            ready
        }
    }
}
