//! The part of a registered alternative that its partners access.

use crate::core::Channel;
use crate::error::RecvError;
use crate::select_state::{Opening, SelectState};
use crate::waiter::Waiter;
use alloc::boxed::Box;
use core::marker::PhantomData;
use core::ptr::{self, NonNull};
use luna_core::biased_lock::InsideGuard;
use luna_core::current::PlainPendingWake;
use luna_platform::sync::atomic::{AtomicPtr, Ordering};

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
    hub: NonNull<Hub<T>>,
    channel: NonNull<Channel<T>>,
    pub(super) next: *mut Entry<T>,
    /// Whether it is on the stack, or known to its owner as ready.
    pub(crate) is_queued: bool,
    /// Whether the owner is yet to be woken for it.
    pub(crate) rings: bool,
    /// How its channel has ended, once its owner has the report: from then on it is not listed.
    /// Belongs to the owner alone.
    ended: Option<RecvError>,
}

/// An entry, for the alternative that it belongs to.
///
/// # Invariants
///
/// The channels of the alternative are borrowed for `'a`. The alternative alone has this and its
/// copies, and uses none of them after it has freed the entry.
pub(super) struct OwnEntry<'a, T>(NonNull<Entry<T>>, PhantomData<&'a Channel<T>>);

impl<T> Clone for OwnEntry<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for OwnEntry<'_, T> {}

impl<'a, T> OwnEntry<'a, T> {
    /// Guard `index` of the alternative around `hub`. Allocates.
    ///
    /// # Safety
    ///
    /// The hub is the caller's, an alternative, and lives as long as this. The caller alone has
    /// this and its copies.
    pub(super) unsafe fn new(hub: NonNull<Hub<T>>, channel: &'a Channel<T>, index: u32) -> Self {
        let entry = Box::new(Entry {
            waiter: Waiter::empty(),
            hub,
            channel: NonNull::from(channel),
            next: ptr::null_mut(),
            is_queued: false,
            rings: false,
            ended: None,
        });
        let entry = NonNull::from(Box::leak(entry));
        // SAFETY: the hub is live, as is demanded here. No other thread knows the new entry; its
        // waiter is its first field.
        unsafe {
            let select_state = NonNull::new_unchecked(&raw mut (*hub.as_ptr()).select_state);
            let guard = Some((select_state, index));
            Waiter::begin(entry.cast::<Waiter<T>>(), guard);
        }
        Self(entry, PhantomData)
    }

    #[inline(always)]
    pub(super) fn pointer(self) -> NonNull<Entry<T>> {
        self.0
    }

    /// The waiter is the first field.
    #[inline(always)]
    pub(super) fn node(self) -> NonNull<Waiter<T>> {
        self.0.cast()
    }

    #[inline(always)]
    pub(super) fn channel(self) -> &'a Channel<T> {
        // SAFETY: by the invariants the entry lives. Its channel is borrowed for `'a`; the field
        // never changes.
        unsafe { (*self.0.as_ptr()).channel.as_ref() }
    }

    /// How its channel has ended, if its alternative has the report.
    #[inline(always)]
    pub(super) fn ended(self) -> Option<RecvError> {
        // SAFETY: by the invariants the entry lives, and this field is its alternative's alone.
        unsafe { (*self.0.as_ptr()).ended }
    }

    /// Sets how its channel has ended; returns what was set before.
    pub(super) fn set_ended(self, error: RecvError) -> Option<RecvError> {
        // SAFETY: by the invariants the entry lives, and this field is its alternative's alone.
        unsafe { (*self.0.as_ptr()).ended.replace(error) }
    }

    /// Frees the entry.
    ///
    /// # Safety
    ///
    /// It is listed nowhere, and no copy of this is used any more.
    pub(super) unsafe fn free(self) {
        // SAFETY: `new` made it of a box, and no other code knows it any more.
        drop(unsafe { Box::from_raw(self.0.as_ptr()) });
    }
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
        opening: &mut InsideGuard<'_, Opening>,
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
            hub.select_state.commit_plainly(opening, index).map(Some)
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
