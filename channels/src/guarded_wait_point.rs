//! Wait points other than channels: those of barriers and locks.

use crate::inspect::{Identity, WaitPointKind, register, unregister};
use crate::wait_point::{WaitPoint, WaitQueues};
use core::ops::Deref;
use core::ptr::NonNull;
use luna_core::deferred_free::Shared;
use luna_platform::sync::UnsafeCell;

/// A wait point with cache lines of its own, and with a state that its lock guards.
///
/// # Invariants
///
/// `state` is accessed under the lock of `wait_point` alone. It is in the register of all wait
/// points before it is used, and until it is dropped.
#[repr(C, align(64))]
pub(crate) struct GuardedWaitPoint<S> {
    wait_point: WaitPoint,
    state: UnsafeCell<S>,
}

// SAFETY: the state is guarded by the wait point's lock.
unsafe impl<S: Send> Sync for GuardedWaitPoint<S> {}

impl<S> GuardedWaitPoint<S> {
    /// Access to the state.
    ///
    /// # Panics
    ///
    /// If `lists` are not those of this wait point.
    #[inline(always)]
    pub(crate) fn state<R>(
        &self,
        lists: &mut WaitQueues,
        f: impl FnOnce(&mut S, &WaitQueues) -> R,
    ) -> R {
        assert!(
            self.wait_point.has(lists),
            "the lists of another wait point"
        );
        // SAFETY: these are the lists that the lock guards: an exclusive borrow shows that it is
        // held, and lasts as long as that of the state. `f` gets a shared one, with which it cannot
        // call this again. So the state is borrowed once.
        self.state
            .with_mut(|state| f(unsafe { &mut *state }, lists))
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
