//! The part of a registered alternative that its partners access.

use crate::core::Channel;
use crate::error::RecvError;
use crate::select_state::SelectState;
use crate::waiter::Waiter;
use luna_core::current::PlainPendingWake;
use luna_platform::sync::atomic::{AtomicPtr, Ordering};
use std::ptr::{self, NonNull};

/// The part of an alternative that partners access.
pub(crate) struct Hub<T> {
    pub(crate) select_state: SelectState,
    /// The entries with channels that have become ready since the owner looked. Changed under the
    /// commit lock.
    pub(super) stack: AtomicPtr<Entry<T>>,
}

impl<T> Hub<T> {
    /// Pushes an entry.
    ///
    /// # Safety
    ///
    /// The commit lock is held, and the entry, with its lock held too, is not on the stack.
    #[inline]
    pub(super) unsafe fn push(&self, entry: *mut Entry<T>) {
        // SAFETY: the entry is live, since its lock is held and it is listed. It is not on the
        // stack, so `next` is this thread's.
        unsafe { (*entry).next = self.stack.load(Ordering::Relaxed) };
        self.stack.store(entry, Ordering::Release);
    }

    /// Takes all that are on the stack.
    ///
    /// # Safety
    ///
    /// The commit lock is held.
    #[inline]
    pub(super) unsafe fn take_stack(&self) -> *mut Entry<T> {
        let first = self.stack.load(Ordering::Relaxed);
        self.stack.store(ptr::null_mut(), Ordering::Relaxed);
        first
    }

    /// Whether there is a report that the owner has not looked at. The answer still holds
    /// afterwards only under the commit lock.
    #[inline]
    pub(super) fn has_news(&self) -> bool {
        !self.stack.load(Ordering::Acquire).is_null()
    }
}

/// A channel's registration.
///
/// # Invariants
///
/// While its node is in the channel's list, that lock guards `waiter.wait`, `is_queued`, and
/// `rings`; the rest of `waiter` belongs to the thread that committed the select state through it,
/// then to the owner. `next` belongs to the thread that pushes the entry, then to the thread that
/// drains the stack.
#[repr(C)]
pub(crate) struct Entry<T> {
    /// First, so that the list's node leads back to this.
    pub(crate) waiter: Waiter<T>,
    pub(super) hub: NonNull<Hub<T>>,
    pub(super) channel: NonNull<Channel<T>>,
    pub(super) next: *mut Entry<T>,
    /// Whether it is on the stack, or known to its owner as ready.
    pub(crate) is_queued: bool,
    /// Whether the owner is yet to be woken for it.
    pub(crate) rings: bool,
    /// How its channel has ended, once its owner has the report: from then on it is not listed.
    /// Belongs to the owner alone.
    pub(super) ended: Option<RecvError>,
}

impl<T> Entry<T> {
    /// Reports that the channel is ready, unless the owner knows. Returns whether it is then to be
    /// rung for.
    ///
    /// # Safety
    ///
    /// `entry` is in its channel's list, and that lock is held.
    pub(crate) unsafe fn announce(entry: NonNull<Entry<T>>) -> bool {
        let entry = entry.as_ptr();
        // SAFETY: the entry is listed and its lock is held, so it is live, and these fields are
        // this thread's. The hub outlives its entries' being listed. The commit lock is held for
        // the push, and an entry that is not queued is not on the stack.
        unsafe {
            if (*entry).is_queued {
                return false;
            }
            (*entry).is_queued = true;
            let hub = (*entry).hub.as_ref();
            let _commit_lock = hub.select_state.commit_lock();
            hub.push(entry);
            // An owner that does not wait looks at the stack before it does.
            (*entry).rings |= hub.select_state.is_open();
            (*entry).rings
        }
    }

    /// Whether its alternative has a report that it has not looked at. Then it does not wait,
    /// though it may not know yet. What came before is to be chosen before what comes now.
    ///
    /// # Safety
    ///
    /// `entry` is in its channel's list, and that lock is held.
    pub(crate) unsafe fn has_news(entry: NonNull<Entry<T>>) -> bool {
        // SAFETY: the entry is listed and its lock is held, so it is live; the hub outlives its
        // entries' being listed, and is shared by atomics here.
        unsafe { (*entry.as_ptr()).hub.as_ref().has_news() }
    }

    /// For a sender on the fast path, with no other waiter: commits the alternative, if it waits
    /// and has no other report; if it does not wait, reports the channel to it. `None` if neither
    /// can be done here.
    ///
    /// # Safety
    ///
    /// `entry` is in its channel's list, and that lock is held, and the commit lock by the executor
    /// that owns its bias. Unless the commit succeeds, the sender waits.
    #[inline(always)]
    pub(crate) unsafe fn commit_or_announce(
        entry: NonNull<Entry<T>>,
    ) -> Option<Option<PlainPendingWake>> {
        let node = entry.cast::<Waiter<T>>();
        let entry = entry.as_ptr();
        // SAFETY: the entry is listed and its lock is held, so it is live, and its fields are this
        // thread's. The hub outlives its entries' being listed. The commit lock is held by its
        // bias, for the push and the commit, and an entry that is not queued is not on the stack.
        // The node was begun with its select state.
        unsafe {
            let hub = (*entry).hub.as_ref();
            if !hub.select_state.is_open() {
                if !(*entry).is_queued {
                    (*entry).is_queued = true;
                    hub.push(entry);
                }
                return Some(None);
            }
            if hub.has_news() {
                return None;
            }
            let (_, index) = Waiter::guard_of(node);
            hub.select_state.commit_plainly(index).map(Some)
        }
    }

    /// The select state of its alternative.
    ///
    /// # Safety
    ///
    /// `entry` is in its channel's list, and that lock is held for as long as the result is used.
    pub(crate) unsafe fn select_state<'a>(entry: NonNull<Entry<T>>) -> &'a SelectState {
        // SAFETY: the entry is listed and its lock is held, so it is live. The hub outlives its
        // entries' being listed, and the lock is held while the reference is used.
        unsafe { &(*(*entry.as_ptr()).hub.as_ptr()).select_state }
    }
}
