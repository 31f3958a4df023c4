//! Wait points other than channels: those of barriers and locks.

use crate::inspect::{Identity, WaitPointKind, register, unregister};
use crate::wait_point::{Lists, WaitPoint, WaitQueues};
use core::ops::{Deref, DerefMut};
use core::ptr::NonNull;
use luna_core::biased_lock::{BiasedGuard, InsideGuard};
use luna_core::current::Here;
use luna_core::deferred_free::Shared;
use luna_platform::sync::UnsafeCell;

/// A wait point with cache lines of its own, and with a state that its lock guards.
///
/// # Invariants
///
/// `state` is accessed by the [`Locked`] of this wait point alone. It is in the register of all
/// wait points before it is used, and until it is dropped.
#[repr(C, align(64))]
pub(crate) struct GuardedWaitPoint<S> {
    wait_point: WaitPoint,
    state: UnsafeCell<S>,
}

// SAFETY: the state is guarded by the wait point's lock.
unsafe impl<S: Send> Sync for GuardedWaitPoint<S> {}

/// A guarded wait point whose lock is held, in whichever way: its lists, and its state.
///
/// # Invariants
///
/// `lists` are those of the wait point that `state` belongs to: so whatever has this holds the
/// lock.
pub(crate) struct Locked<'a, S, L> {
    state: &'a UnsafeCell<S>,
    lists: L,
}

impl<S> GuardedWaitPoint<S> {
    /// Locks.
    #[inline]
    pub(crate) fn lock(&self) -> Locked<'_, S, BiasedGuard<'_, WaitQueues>> {
        self.lock_in(Here::now())
    }

    /// Locks, on the calling thread.
    #[inline(always)]
    pub(crate) fn lock_in(&self, here: Here<'_>) -> Locked<'_, S, BiasedGuard<'_, WaitQueues>> {
        Locked {
            state: &self.state,
            lists: self.wait_point.lock_in(here),
        }
    }

    /// Locks, if the lock is biased to the executor of the calling thread.
    #[inline(always)]
    pub(crate) fn enter_in(
        &self,
        here: Here<'_>,
    ) -> Option<Locked<'_, S, InsideGuard<'_, WaitQueues>>> {
        let lists = self.wait_point.enter_in(here)?;
        let state = &self.state;
        Some(Locked { state, lists })
    }

    /// With lists that code has locked which does not know this state.
    ///
    /// # Panics
    ///
    /// If `lists` are not those of this wait point.
    pub(crate) fn locked<'a>(
        &'a self,
        lists: &'a mut WaitQueues,
    ) -> Locked<'a, S, &'a mut WaitQueues> {
        assert!(
            self.wait_point.lock.guards(lists),
            "the lists of another wait point"
        );
        let state = &self.state;
        Locked { state, lists }
    }
}

impl<S, L: Lists> Locked<'_, S, L> {
    /// What the lock guards beside the lists.
    #[inline(always)]
    pub(crate) fn state(&mut self) -> &mut S {
        self.parts().0
    }

    /// The state, and the lists beside it.
    #[inline(always)]
    pub(crate) fn parts(&mut self) -> (&mut S, &mut WaitQueues) {
        // SAFETY: by the invariant the lock is held; the exclusive borrow excludes another one of
        // the state, and lasts as long.
        let state = self.state.with_mut(|state| unsafe { &mut *state });
        (state, &mut self.lists)
    }
}

impl<S, L: Lists> Deref for Locked<'_, S, L> {
    type Target = WaitQueues;
    #[inline(always)]
    fn deref(&self) -> &WaitQueues {
        &self.lists
    }
}

impl<S, L: Lists> DerefMut for Locked<'_, S, L> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut WaitQueues {
        &mut self.lists
    }
}

impl<S: Send + 'static> GuardedWaitPoint<S> {
    /// One that several handles share.
    #[track_caller]
    pub(crate) fn share(kind: WaitPointKind, state: S) -> Shared<Self> {
        let shared = Shared::new(Self {
            wait_point: WaitPoint::new(Identity::new(kind)),
            state: UnsafeCell::new(state),
        });
        // SAFETY: it stays in its allocation until its drop takes it off the register. It stores no
        // values, so its `stored` looks at nothing.
        unsafe { register(NonNull::from(&shared.wait_point)) };
        shared
    }
}

impl<S> Deref for GuardedWaitPoint<S> {
    type Target = WaitPoint;
    #[inline(always)]
    fn deref(&self) -> &WaitPoint {
        &self.wait_point
    }
}

impl<S> Drop for GuardedWaitPoint<S> {
    fn drop(&mut self) {
        unregister(&self.wait_point);
    }
}
