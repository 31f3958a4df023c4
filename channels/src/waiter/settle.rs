//! How a partner takes a listed node: commits its alternative, takes its wake handle, and settles
//! its outcome.

use super::{Begun, Outcome, Waiter};
use crate::select_state::SelectState;
use core::ptr::NonNull;
use luna_core::current::{Here, PendingWake, PlainPendingWake, WakeHandle};
use luna_core::wait_list::WaitNode;
use luna_platform::sync::atomic::{AtomicU8, Ordering};

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

    /// Settles a waiting operation as done; its wake handle was taken. The node is not to be
    /// touched after this.
    ///
    /// # Safety
    ///
    /// As for [`settle`](Self::settle), of `Done`.
    #[inline(always)]
    pub(crate) unsafe fn settle_plain(node: NonNull<Waiter<T>>) {
        // SAFETY: the node waits until this store, and its future needs the lock that is held here
        // to withdraw it: so it is live. Only the outcome is borrowed, which the future may load.
        unsafe {
            (*Self::link(node))
                .outcome
                .store(Outcome::Done as u8, Ordering::Release);
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

    /// Settles a waiting operation as stale that holds no wake handle: an alternative's that was
    /// not committed. The node is not to be touched after this.
    ///
    /// # Safety
    ///
    /// As for [`settle`](Self::settle), of `Stale`. A node that waits alone may still be noted in
    /// `waiting`, if the caller overwrites that before it releases the lock.
    #[inline(always)]
    pub(crate) unsafe fn settle_stale(node: NonNull<Waiter<T>>) {
        // SAFETY: the node waits until this store, and its future needs the lock that is held here
        // to withdraw it: so it is live. Only the outcome is borrowed, which the future may load.
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
    /// `node` is that of a held sender, or of a party of a completed round of a barrier. It was
    /// just taken off its list, and the lock is held that guards it.
    pub(crate) unsafe fn release(node: NonNull<Waiter<T>>) -> PendingWake {
        // SAFETY: the node was listed, its lock is held, and it is over for good: a held sender's
        // value was received, a party's round is complete. So `Done` is its outcome, and its future
        // waits until then.
        unsafe { Self::settle(node, Outcome::Done) }
    }
}
