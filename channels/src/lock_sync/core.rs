//! What a mutex and a semaphore have in common: permits, waiters for them, and the holder of a
//! mutex. A mutex has one permit.

use super::take;
use crate::guarded_wait_point::{GuardedWaitPoint, Locked};
use crate::inspect::WaitPointKind;
use crate::replay;
use crate::wait_point::{LastUser, Lists};
use core::marker::PhantomData;
use luna_core::current::{self, Here, Inheritor, Priority};
use luna_core::deferred_free::Shared;
use luna_core::wait_list::WaitList;

/// The free permits, and the holder's inheritor.
pub(super) struct LockState {
    pub(super) permits: u64,
    /// The holder of a mutex, boosted by the first waiter. None if it is a task of another runtime.
    pub(super) inheritor: Option<Inheritor>,
}

/// Shared by all handles of a mutex or a semaphore, but for the guarded value.
///
/// # Invariants
///
/// All nodes in the [list of waiters](Locked::waiting) are entries. If there is a waiter, there are
/// fewer permits than it wants, so a mutex with a waiter is held. The last user as a receiver is
/// the holder of a mutex, or the last to take permits of a semaphore.
pub(super) type Core = GuardedWaitPoint<LockState>;

/// That the caller has permits of a core: the guard or the permit is made of it. Dropped, they are
/// lost.
///
/// # Invariants
///
/// A take of that core has succeeded, and no other hold was made of it. It is used for a guard of
/// the same core; only a debug build knows which.
#[must_use = "the permits are lost otherwise"]
pub struct Hold<'a> {
    #[cfg(debug_assertions)]
    core: &'a Core,
    of: PhantomData<&'a Core>,
}

luna_platform::debug_fields!(Hold<'_>);

impl<'a> Hold<'a> {
    /// # Safety
    ///
    /// As the invariants say.
    #[inline(always)]
    pub(super) unsafe fn new(core: &'a Core) -> Self {
        let _ = core;
        Self {
            #[cfg(debug_assertions)]
            core,
            of: PhantomData,
        }
    }

    /// Its permits are those of this core.
    #[inline(always)]
    pub(super) fn used_for(self, core: &Core) {
        let _ = core;
        #[cfg(debug_assertions)]
        assert!(core::ptr::eq(self.core, core), "a hold of another core");
    }
}

impl Core {
    /// A new one, for its first handle. Allocates.
    #[track_caller]
    pub(super) fn with_permits(kind: WaitPointKind, permits: u32) -> Shared<Core> {
        let state = LockState {
            permits: u64::from(permits),
            inheritor: None,
        };
        Self::share(kind, state)
    }

    /// Whether it is a mutex: its holder inherits. A semaphore's permits belong to no process.
    pub(super) fn has_owner(&self) -> bool {
        self.identity.values.kind == WaitPointKind::Mutex
    }

    /// Remembers that a user of a semaphore is outside of the system.
    #[inline(always)]
    pub(super) fn note_user(&self, here: Here<'_>) {
        if !self.has_owner() {
            self.note_outsider(here.user());
        }
    }

    /// The inheritor for permits that the caller takes: none for those of a semaphore.
    pub(super) fn inheritor(&self, of_thread: bool) -> Option<Inheritor> {
        match self.has_owner() {
            true => take::caller(of_thread),
            false => None,
        }
    }

    /// The number of free permits.
    pub(super) fn permits(&self) -> u64 {
        self.lock().state().permits
    }

    /// Takes permits for the caller, if they are free and no waiter is as urgent. `holder` gives
    /// the inheritor of the holder then, under the lock.
    #[inline(always)]
    pub(super) fn take(
        &self,
        here: Here<'_>,
        count: u32,
        holder: impl FnOnce() -> Option<Inheritor>,
    ) -> bool {
        let priority = || here.priority();
        self.lock_in(here).take(here, count, priority, holder)
    }

    /// Takes permits of a semaphore in a replay, where the recorded process got some. The process
    /// that made room for them may do so a little later, since what it does at once after that may
    /// have to wait; so their number is not tested, and may be below 0 for a while.
    #[cold]
    pub(super) fn take_given(&self, count: u32) {
        let mut locked = self.lock();
        let state = locked.state();
        state.permits = state.permits.wrapping_sub(u64::from(count));
    }

    /// Takes permits, if that can be done at once.
    pub(super) fn try_take(&self, count: u32) -> Option<Hold<'_>> {
        let here = Here::now();
        self.note_user(here);
        // SAFETY: permits were taken, for this hold alone.
        let hold = |is_taken: bool| is_taken.then(|| unsafe { Hold::new(self) });
        let take = || {
            let mut inheritor = self.inheritor(true);
            self.take(here, count, || inheritor.take())
        };
        if !current::has_replay_log() {
            return hold(take());
        }
        // That of a semaphore has no stamp: a replay need not wait for the process that makes room.
        let taken = replay::call(
            self.has_owner(),
            || match !self.has_owner() && current::is_replayed() {
                true => {
                    self.take_given(count);
                    true
                }
                false => take(),
            },
            |taken| (!taken).then_some(replay::failure::NOTHING),
        );
        hold(taken.unwrap_or_default())
    }
}

impl<L: Lists> Locked<'_, LockState, L> {
    /// Those that wait for permits, by priority: under this name in the lists of any wait point.
    #[inline(always)]
    pub(super) fn waiting(&mut self) -> &mut WaitList {
        &mut self.senders
    }

    /// Takes permits for the caller, if they are free and no waiter is as urgent. `holder` gives
    /// the inheritor of the holder then.
    #[inline(always)]
    pub(super) fn take(
        &mut self,
        here: Here<'_>,
        count: u32,
        priority: impl FnOnce() -> Priority,
        holder: impl FnOnce() -> Option<Inheritor>,
    ) -> bool {
        let first = self.waiting().first();
        // SAFETY: a listed node is live, and the lock is held.
        let is_first = first.is_none_or(|first| priority() > unsafe { first.as_ref() }.priority());
        let state = self.state();
        let left = state.permits.checked_sub(u64::from(count));
        let Some(left) = left.filter(|_| is_first) else {
            return false;
        };
        state.permits = left;
        state.inheritor = holder();
        self.receiver = LastUser::of(here.user());
        true
    }
}
