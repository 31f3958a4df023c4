//! What a mutex and a semaphore have in common: permits, waiters for them, and the holder of a
//! mutex. A mutex has one permit. Permits that are given back go to the waiters, by priority.

use super::entry::{Changed, Entry, end_boost, follow};
use super::take;
use crate::finally::Finally;
use crate::guarded_wait_point::{GuardedWaitPoint, Locked};
use crate::inspect::WaitPointKind;
use crate::replay;
use crate::wait_point::{LastUser, Lists};
use crate::waiter::{Outcome, Waiter};
use core::marker::PhantomData;
use core::ptr::NonNull;
use luna_core::current::{self, Here, Inheritor, PendingWake, Priority};
use luna_core::deferred_free::Shared;
use luna_core::wait_list::{WaitList, WaitNode};

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

/// Work that is due after an entry became the holder, or waits to.
#[must_use = "the process stays asleep, and the chain as it was"]
pub(super) struct Admitted {
    ready: PendingWake,
    changed: Option<Changed>,
}

impl Admitted {
    /// Wakes the new holder and follows the chain. Called without any lock.
    pub(super) fn carry_out(self) {
        let mut changed = self.changed;
        let _chain = Finally::new(|| follow(changed.take()));
        self.ready.wake();
    }
}

impl Core {
    /// Gives permits back, and serves the waiters.
    #[inline(never)]
    pub(super) fn give_back(&self, count: u32) {
        let here = Here::now();
        match self.enter_in(here) {
            Some(locked) => self.give_back_under(locked, here, count),
            None => self.give_back_under(self.lock_in(here), here, count),
        }
    }

    /// As [`give_back`](Self::give_back), under the lock, in whichever way it is held.
    #[inline(always)]
    fn give_back_under(
        &self,
        mut locked: Locked<'_, LockState, impl Lists>,
        here: Here<'_>,
        count: u32,
    ) {
        if self.has_owner() {
            locked.receiver = LastUser::NONE;
        }
        let state = locked.state();
        // From below 0, maybe, in a replay.
        state.permits = state.permits.wrapping_add(u64::from(count));
        let former = Inheritor::end(&mut state.inheritor, here);
        if former.is_some() || !locked.waiting().is_empty() {
            self.serve_all(locked, former);
        }
    }

    #[inline(never)]
    fn serve_all(&self, locked: Locked<'_, LockState, impl Lists>, mut former: Option<Inheritor>) {
        // After the next holder was woken, also if its waker panics.
        let _end_boost = Finally::new(|| end_boost(former.take()));
        if self.serve_first(locked) {
            self.serve();
        }
    }

    /// Serves waiters, as far as the permits go.
    pub(super) fn serve(&self) {
        while self.serve_first(self.lock()) {}
    }

    /// Serves the first waiter, if there are enough permits. Returns whether there are enough for
    /// the next one.
    fn serve_first(&self, mut locked: Locked<'_, LockState, impl Lists>) -> bool {
        let Some(node) = locked.first_to_serve() else {
            return false;
        };
        // SAFETY: the node is in the list, so it is a live entry's, and the lock is held.
        let next = unsafe {
            locked.waiting().remove(node);
            locked.hand_over(Entry::of(node))
        };
        let are_enough_left = locked.first_to_serve().is_some();
        drop(locked);
        // A wake may panic: the remaining wakes must still be done.
        let rest = Finally::new(|| self.serve());
        next.carry_out();
        rest.cancel();
        are_enough_left
    }

    /// Takes in an entry that waited at a condition: it holds the mutex, or waits for it.
    ///
    /// # Safety
    ///
    /// `entry` was begun for this mutex, is in no list, and its future is kept by the condition's
    /// lock.
    pub(super) unsafe fn admit(&self, entry: NonNull<Entry>) -> Admitted {
        let mut locked = self.lock();
        // SAFETY: the entry was begun for this mutex, is in no list, and the condition's lock,
        // which is held, keeps its future until it is listed here or settled, as is demanded here.
        unsafe {
            if locked.state().permits > 0 {
                return locked.hand_over(entry);
            }
            let node = Entry::node(entry);
            locked
                .waiting()
                .insert_again_at(node, Entry::priority(entry));
        }
        Admitted {
            ready: PendingWake::NONE,
            changed: locked.boost_holder(),
        }
    }
}

impl<L: Lists> Locked<'_, LockState, L> {
    /// The first waiter, if there are enough permits for it.
    fn first_to_serve(&mut self) -> Option<NonNull<WaitNode>> {
        let node = self.waiting().first()?;
        // SAFETY: the node is in the list, so it is a live entry's, and the lock is held.
        let count = unsafe { (*Entry::of(node).as_ptr()).count };
        (u64::from(count) <= self.state().permits).then_some(node)
    }

    /// Gives `entry`, which was just taken off its list, its permits, of which there are enough. It
    /// is not to be touched after this.
    ///
    /// # Safety
    ///
    /// `entry` was begun and waits; it is in no list, and the lock under which it was taken off is
    /// still held.
    unsafe fn hand_over(&mut self, entry: NonNull<Entry>) -> Admitted {
        // SAFETY: the entry was begun and waits, and the lock under which it was taken off is still
        // held, as is demanded here: so it is live, and no other thread accesses it, until it is
        // settled.
        unsafe {
            let state = self.state();
            state.permits -= u64::from((*entry.as_ptr()).count);
            state.inheritor = Entry::inheritor(entry).map(Inheritor::copy);
            self.receiver = LastUser::of(Entry::node(entry).as_ref().user());
            Admitted {
                changed: self.boost_holder(),
                ready: Waiter::settle(Entry::waiter(entry), Outcome::Done),
            }
        }
    }
}
