//! Giving permits back: the waiters get them, by priority.

use super::chain::{self, Changed};
use super::core::{Core, LockState};
use super::entry::Entry;
use crate::finally::Finally;
use crate::guarded_wait_point::Locked;
use crate::wait_point::{LastUser, Lists};
use crate::waiter::{Outcome, Waiter};
use core::ptr::NonNull;
use luna_core::current::{Here, Inheritor, PendingWake};
use luna_core::wait_list::WaitNode;

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
        let _chain = Finally::new(|| chain::follow(changed.take()));
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
        let _end_boost = Finally::new(|| chain::end_boost(former.take()));
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
