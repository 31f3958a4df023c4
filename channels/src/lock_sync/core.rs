//! What a mutex and a semaphore have in common: permits, waiters for them, and the holder of a
//! mutex. A mutex has one permit.

use super::chain;
use super::entry::Entry;
use super::take;
use crate::guarded_wait_point::GuardedWaitPoint;
use crate::inspect::WaitPointKind;
use crate::replay;
use crate::wait_point::{LastUser, WaitQueues};
use crate::waiter::{Outcome, Waiter};
use core::ptr::NonNull;
use core::task::{Context, Poll};
use luna_core::current::{self, Here, Inheritor, Priority, Renewal, User, WakeHandle};
use luna_core::deferred_free::Shared;

/// The free permits, and the holder's inheritor.
pub(super) struct State {
    pub(super) permits: u64,
    /// The holder of a mutex, boosted by the first waiter. None if it is a task of another runtime.
    pub(super) inheritor: Option<Inheritor>,
}

/// Shared by all handles of a mutex or a semaphore, but for the guarded value.
///
/// # Invariants
///
/// Waiters are in the wait point's list of senders, and all its nodes are entries. If there is a
/// waiter, there are fewer permits than it wants, so a mutex with a waiter is held. The last user
/// as a receiver is the holder of a mutex, or the last to take permits of a semaphore.
pub(super) type Core = GuardedWaitPoint<State>;

impl Core {
    /// A new one, for its first handle. Allocates.
    #[track_caller]
    pub(super) fn with_permits(kind: WaitPointKind, permits: u32) -> Shared<Core> {
        let state = State {
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
        if !self.has_owner() && here.user() == User::Outside {
            self.identity.set_external();
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
        let mut lists = self.lock();
        self.state(&mut lists, |state, _| state.permits)
    }

    /// Takes permits for the caller, if they are free and no waiter is as urgent. `holder` gives the
    /// inheritor of the holder then, under the lock.
    #[inline(always)]
    pub(super) fn take(
        &self,
        here: Here<'_>,
        count: u32,
        holder: impl FnOnce() -> Option<Inheritor>,
    ) -> bool {
        let mut lists = self.lock_in(here);
        self.take_locked(&mut lists, here, count, || here.priority(), holder)
    }

    #[inline(always)]
    pub(super) fn take_locked(
        &self,
        lists: &mut WaitQueues,
        here: Here<'_>,
        count: u32,
        priority: impl FnOnce() -> Priority,
        holder: impl FnOnce() -> Option<Inheritor>,
    ) -> bool {
        let first = lists.senders.first();
        // SAFETY: a listed node is live, and the lock is held.
        let is_first = first.is_none_or(|first| priority() > unsafe { first.as_ref() }.priority());
        let is_taken = is_first
            && self.state(lists, |state, _| {
                let left = state.permits.checked_sub(u64::from(count));
                state.permits = left.unwrap_or(state.permits);
                left.is_some()
            });
        if is_taken {
            let holder = holder();
            self.state(lists, |state, _| state.inheritor = holder);
            lists.receiver = LastUser::of(here.user());
        }
        is_taken
    }

    /// Takes permits of a semaphore in a replay, where the recorded process got some. The process
    /// that made room for them may do so a little later, since what it does at once after that may
    /// have to wait; so their number is not tested, and may be below 0 for a while.
    #[cold]
    pub(super) fn take_given(&self, count: u32) {
        let mut lists = self.lock();
        self.state(&mut lists, |state, _| {
            state.permits = state.permits.wrapping_sub(u64::from(count));
        });
    }

    /// Takes permits, if that can be done at once.
    pub(super) fn try_take(&self, count: u32) -> bool {
        let here = Here::now();
        self.note_user(here);
        let take = || {
            let mut inheritor = self.inheritor(true);
            self.take(here, count, || inheritor.take())
        };
        if !current::has_replay_log() {
            return take();
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
        taken.unwrap_or_default()
    }

    /// Takes permits for the caller, if they are free and no waiter is as urgent; else lists the
    /// entry. The caller drops the renewal when it has noted which.
    ///
    /// # Safety
    ///
    /// `entry` is the caller's, pinned and not begun. If it is pending, it is taken
    /// back by [`withdraw`](Self::withdraw) or has become `Done` before it goes, and then ended.
    pub(super) unsafe fn take_or_list(
        this: &Shared<Core>,
        entry: NonNull<Entry>,
        here: Here<'_>,
        count: u32,
        (priority, mut inheritor): (Priority, Option<Inheritor>),
        renewal: &mut Renewal<'_, '_>,
    ) -> Poll<()> {
        let mut changed = None;
        let listed = renewal.put(|renewal| {
            let mut lists = this.lock_in(here);
            let at = || priority;
            if this.take_locked(&mut lists, here, count, at, || inheritor.take()) {
                return Poll::Ready(());
            }
            let Some(wake_handle) = renewal.take() else {
                return Poll::Pending;
            };
            // SAFETY: the entry is the caller's, pinned and not begun, and is taken back or done,
            // and then ended, before it goes, as is demanded here. Listed with its process before
            // the priority is read again, and in the list of this wait point's lock.
            changed = unsafe {
                Entry::begin(entry, this, count, inheritor.take());
                let node = Entry::node(entry);
                lists.senders.insert(node, priority, wake_handle);
                this.requeue(&mut lists, entry);
                this.boost_holder(&mut lists)
            };
            Poll::Pending
        });
        if listed.is_ready() {
            return Poll::Ready(());
        }
        chain::follow(changed);
        this.waits();
        Poll::Pending
    }

    /// Whether a listed entry was given its permits; otherwise the poller's waker from `cx` is
    /// woken then.
    ///
    /// # Safety
    ///
    /// `entry` is the caller's, and was listed here.
    pub(super) unsafe fn poll_listed(&self, entry: NonNull<Entry>, cx: &Context<'_>) -> Poll<()> {
        // SAFETY: the entry is the caller's and was listed here, as is demanded here: so it is live
        // and was begun. Under the lock a waiting node may be changed.
        unsafe {
            if Entry::outcome(entry) == Outcome::Done {
                return Poll::Ready(());
            }
            let mut renewal = Renewal::of(cx);
            let polled = renewal.put(|renewal| {
                let _lists = self.lock();
                if Entry::outcome(entry) == Outcome::Done {
                    return Poll::Ready(());
                }
                renewal.store((*Entry::link(entry)).wait.wake_handle_mut());
                Poll::Pending
            });
            if polled.is_pending() {
                self.waits();
            }
            polled
        }
    }

    /// Takes a listed entry back, unless it was given its permits: `true`. Its wake handle is to
    /// be dropped when the entry was ended.
    ///
    /// # Safety
    ///
    /// As for [`poll_listed`](Self::poll_listed): `entry` is the caller's, and was listed here.
    #[must_use = "the handle's drop is user code, and the caller's last step"]
    pub(super) unsafe fn withdraw(&self, entry: NonNull<Entry>) -> (bool, Option<WakeHandle>) {
        self.waits_no_more();
        let mut lists = self.lock();
        // SAFETY: the entry is the caller's and was listed here, as is demanded here: so it is live
        // and was begun. Under the lock one that is not done is in the list of senders, and is
        // settled after it was taken off.
        let (changed, former) = unsafe {
            if Entry::outcome(entry) == Outcome::Done {
                return (true, None);
            }
            lists.senders.remove(Entry::node(entry));
            let former = (*Entry::link(entry)).wait.wake_handle_mut().take();
            Waiter::settle_stale(Entry::waiter(entry));
            (self.boost_holder(&mut lists), former)
        };
        drop(lists);
        chain::follow(changed);
        if !self.has_owner() {
            // Waiters behind it may want fewer permits.
            self.serve();
        }
        (false, former)
    }
}
