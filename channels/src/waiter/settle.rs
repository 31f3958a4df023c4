//! How a partner takes a listed node: commits its alternative, takes its wake handle, and settles
//! its outcome.

use super::{Begun, Outcome, Waiter};
use crate::select_state::SelectState;
use luna_core::current::{PendingWake, PlainPendingWake, WakeHandle};
use luna_core::wait_list::WaitNode;
use luna_platform::sync::atomic::Ordering;
use std::ptr::NonNull;

/// Claims the select state of a node, and gives the node the wake handle.
///
/// # Safety
///
/// `node` begins a listed waiter, whatever the type of its values, and the lock is held that guards
/// it.
#[cold]
pub(super) unsafe fn commit_select_state(
    node: NonNull<WaitNode>,
    select_state: NonNull<SelectState>,
    guard: u32,
) -> bool {
    // SAFETY: by the contract; a listed node's select state is live.
    unsafe {
        match select_state.as_ref().commit(guard) {
            Some(wake_handle) => {
                *(*node.as_ptr()).wake_handle_mut() = wake_handle;
                true
            }
            None => false,
        }
    }
}

impl<T> Waiter<T> {
    /// Whether [`take_plain_wake_handle`](Self::take_plain_wake_handle) will find a wake handle.
    ///
    /// # Safety
    ///
    /// As there.
    #[inline(always)]
    pub(crate) unsafe fn has_plain_wake_handle(node: NonNull<Waiter<T>>) -> bool {
        // SAFETY: the contract.
        unsafe {
            let link = Self::link(node);
            (*link).begun == Begun::Plainly && WakeHandle::is_plain((*link).wait.wake_handle_mut())
        }
    }

    /// Takes the wake handle of an operation that was listed by [`begin_plain`](Self::begin_plain).
    /// The node is then to be unlisted and settled. `None` for another operation, with no state
    /// changed.
    ///
    /// # Safety
    ///
    /// `node` is listed, and the lock is held that guards it.
    #[inline(always)]
    pub(crate) unsafe fn take_plain_wake_handle(
        node: NonNull<Waiter<T>>,
    ) -> Option<PlainPendingWake> {
        // SAFETY: the contract.
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

    /// The wake handle, to be changed: from here on it may differ from a plain operation's.
    ///
    /// # Safety
    ///
    /// As for [`take_plain_wake_handle`](Self::take_plain_wake_handle).
    pub(crate) unsafe fn change_wake_handle<'a>(
        node: NonNull<Waiter<T>>,
    ) -> &'a mut Option<WakeHandle> {
        // SAFETY: the contract.
        unsafe {
            let link = Self::link(node);
            if (*link).begun == Begun::Plainly {
                (*link).begun = Begun::PlainlyAndChanged;
            }
            (*link).wait.wake_handle_mut()
        }
    }

    /// Settles a waiting operation as done; its wake handle was taken. The node is not to be
    /// touched after this.
    ///
    /// # Safety
    ///
    /// As for [`settle`](Self::settle).
    #[inline(always)]
    pub(crate) unsafe fn settle_plain(node: NonNull<Waiter<T>>) {
        // SAFETY: as there.
        unsafe {
            (*Self::link(node))
                .outcome
                .store(Outcome::Done as u8, Ordering::Release);
        }
    }

    /// Settles a waiting operation as stale that holds no wake handle: an alternative's that was
    /// not committed. The node is not to be touched after this.
    ///
    /// # Safety
    ///
    /// As for [`settle`](Self::settle).
    #[inline(always)]
    pub(crate) unsafe fn settle_stale(node: NonNull<Waiter<T>>) {
        // SAFETY: as there.
        unsafe {
            (*Self::link(node))
                .outcome
                .store(Outcome::Stale as u8, Ordering::Release);
        }
    }

    /// Claims the alternative of the node, if it has one. `false`: the alternative has chosen
    /// already. Otherwise the node is to be settled, and holds the alternative's wake handle.
    ///
    /// # Safety
    ///
    /// `node` is listed, and the lock is held that guards it.
    #[inline(always)]
    pub(crate) unsafe fn commit(node: NonNull<Waiter<T>>) -> bool {
        // SAFETY: the contract.
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
    /// `node` is live, and the lock is held that guards it.
    #[inline]
    pub(super) unsafe fn take_wake_handle(node: NonNull<Waiter<T>>) -> PendingWake {
        // SAFETY: the contract.
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
    /// `node` is a waiter's, was committed and taken off its list under the lock that is still
    /// held, or it is stale; and its state agrees with `outcome`.
    #[inline]
    pub(crate) unsafe fn settle(node: NonNull<Waiter<T>>, outcome: Outcome) -> PendingWake {
        // SAFETY: the future is pending until the store, and cannot go while the lock is held.
        unsafe {
            let ready = Self::take_wake_handle(node);
            // Release: the value and all that came before is visible to a thread that sees the
            // outcome.
            (*Self::link(node))
                .outcome
                .store(outcome as u8, Ordering::Release);
            ready
        }
    }

    /// Releases a held sender, which was just taken off the list `held`. The node is not to be
    /// touched after this.
    ///
    /// # Safety
    ///
    /// `node` is a held sender's, was just unlisted, and the lock is held that guards it.
    pub(crate) unsafe fn release(node: NonNull<Waiter<T>>) -> PendingWake {
        // SAFETY: the contract.
        unsafe { Self::settle(node, Outcome::Done) }
    }
}
