//! The part of a mutex that does not depend on the type of its value: holder, waiters, and priority
//! inheritance.

use super::chain::{self, Changed};
use super::entry::Entry;
use crate::finally::Finally;
use crate::inspect::{Identity, WaitPointKind};
use crate::wait_point::{AlignedWaitPoint, LastUser, WaitQueues};
use crate::waiter::{Outcome, Waiter};
use luna_core::biased_lock::Refused;
use luna_core::current::{
    self, Inheritor, PendingWake, PlainTurn, Priority, Process, Renewal, User, WakeHandle,
};
use luna_core::deferred_free::{self, Retired};
use luna_platform::sync::UnsafeCell;
use luna_platform::sync::atomic::{AtomicUsize, Ordering};
use std::ops::Deref;
use std::ptr::NonNull;
use std::sync::atomic::AtomicBool;
use std::task::{Context, Poll};

/// Whether it is held, and the holder's inheritor.
struct State {
    is_held: bool,
    /// The holder, boosted by the first waiter. None if it is a task of another runtime.
    inheritor: Option<Inheritor>,
}

/// Shared by all handles of a mutex, but for its value.
///
/// # Invariants
///
/// `state` is accessed under the lock of `wait_point` alone. Waiters are in its list of senders,
/// and all its nodes are entries. If there is a waiter, the mutex is held. Its last user as a
/// receiver is the holder. `has_died` is written by the holder, or under the lock as it ceases to
/// hold the mutex.
#[repr(C)]
pub(super) struct Core {
    /// First, so that it leads back to the whole.
    retired: Retired,
    /// All handles count as one; the others are those of [`CoreRef`].
    references: AtomicUsize,
    pub(super) wait_point: AlignedWaitPoint,
    state: UnsafeCell<State>,
    has_died: AtomicBool,
}

// SAFETY: the state is guarded by the wait point's lock.
unsafe impl Sync for Core {}
// SAFETY: as above; what it holds may go to other threads.
unsafe impl Send for Core {}

/// Keeps a mutex's memory, not its value.
pub(super) struct CoreRef(NonNull<Core>);

impl CoreRef {
    /// # Safety
    ///
    /// The core is live.
    pub(super) unsafe fn new(core: NonNull<Core>) -> Self {
        // SAFETY: the contract. Relaxed: whatever keeps it live now was passed on by other means.
        unsafe { core.as_ref() }
            .references
            .fetch_add(1, Ordering::Relaxed);
        Self(core)
    }

    pub(super) fn pointer(&self) -> NonNull<Core> {
        self.0
    }
}

impl Deref for CoreRef {
    type Target = Core;
    fn deref(&self) -> &Core {
        // SAFETY: it is counted, so it is live.
        unsafe { self.0.as_ref() }
    }
}

impl Drop for CoreRef {
    fn drop(&mut self) {
        // SAFETY: it was counted.
        unsafe { Core::let_go(self.0) };
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
        let _chain = Finally::new(|| chain::follow(changed.take()));
        self.ready.wake();
    }
}

impl Core {
    #[track_caller]
    pub(super) fn new(free: unsafe fn(NonNull<Retired>)) -> Self {
        Self {
            retired: Retired::new(free),
            references: AtomicUsize::new(1),
            wait_point: AlignedWaitPoint::new(Identity::new(WaitPointKind::Mutex)),
            state: UnsafeCell::new(State {
                is_held: false,
                inheritor: None,
            }),
            has_died: AtomicBool::new(false),
        }
    }

    /// Counts one reference less. The memory of the last one is freed off the real-time path.
    ///
    /// # Safety
    ///
    /// The reference is the caller's, and the caller does not use it any more.
    pub(super) unsafe fn let_go(core: NonNull<Core>) {
        // SAFETY: by the contract, each reference is let go once; after the last one the core is
        // not used any more.
        unsafe {
            if core.as_ref().references.fetch_sub(1, Ordering::AcqRel) == 1 {
                deferred_free::retire(core.cast());
            }
        }
    }

    fn state<R>(&self, _lists: &WaitQueues, f: impl FnOnce(&mut State) -> R) -> R {
        // SAFETY: the lists show that the lock is held, and `f` cannot come here again, since it
        // gets no lists.
        self.state.with_mut(|state| f(unsafe { &mut *state }))
    }

    /// Whether the former holder died while it held the mutex. Asked by the holder.
    #[inline]
    pub(super) fn has_died(&self) -> bool {
        // Relaxed: the lock, or the outcome of a node, came in between.
        self.has_died.load(std::sync::atomic::Ordering::Relaxed)
    }

    /// Said by the holder.
    pub(super) fn set_died(&self, has_died: bool) {
        self.has_died
            .store(has_died, std::sync::atomic::Ordering::Relaxed);
    }

    /// Locks it for the current process, if it is free, its wait point's lock is biased to this
    /// executor, and no other process is to run first. `false`: it is not so, and no state has
    /// changed. O(1), without atomic read-modify-writes.
    #[inline(never)]
    pub(super) fn take_fast(&self, turn: PlainTurn<'_>) -> bool {
        // SAFETY: no user code runs under this lock, so nothing polls while this thread holds it.
        let mut lists = match unsafe { self.wait_point.enter(turn) } {
            Ok(lists) => lists,
            Err(Refused::NotBiased) => return false,
            Err(Refused::Revoked) => {
                self.wait_point.after_revocation();
                return false;
            }
        };
        let is_taken = self.state(&lists, |state| {
            let is_taken = !state.is_held && turn.goes_on();
            if is_taken {
                state.is_held = true;
                state.inheritor = Inheritor::current();
            }
            is_taken
        });
        if is_taken {
            lists.receiver = LastUser::process(turn.process().id());
        }
        is_taken
    }

    /// Locks it for the caller, if it is free; else gives the inheritor back.
    pub(super) fn take(&self, inheritor: Option<Inheritor>) -> Result<(), Option<Inheritor>> {
        let mut lists = self.wait_point.lock();
        self.take_locked(&mut lists, inheritor, current::user())
    }

    fn take_locked(
        &self,
        lists: &mut WaitQueues,
        inheritor: Option<Inheritor>,
        user: User,
    ) -> Result<(), Option<Inheritor>> {
        self.state(lists, |state| {
            if state.is_held {
                return Err(inheritor);
            }
            state.is_held = true;
            state.inheritor = inheritor;
            Ok(())
        })?;
        lists.receiver = LastUser::of(user);
        Ok(())
    }

    /// Locks it for the caller, if it is free; else lists the entry. The caller drops the renewal
    /// when it has noted which.
    ///
    /// # Safety
    ///
    /// `entry` is the caller's, pinned and not begun. If it is pending, it is taken back by
    /// [`withdraw`](Self::withdraw) or has become `Done` before it goes, and then ended.
    pub(super) unsafe fn take_or_list(
        &self,
        entry: NonNull<Entry>,
        mut inheritor: Option<Inheritor>,
        renewal: &mut Renewal<'_, '_>,
    ) -> Poll<()> {
        let user = current::user();
        let mut changed = None;
        let listed = renewal.put(|renewal| {
            let mut lists = self.wait_point.lock();
            inheritor = match self.take_locked(&mut lists, inheritor.take(), user) {
                Ok(()) => return Poll::Ready(()),
                Err(inheritor) => inheritor,
            };
            let Some(wake_handle) = renewal.take() else {
                return Poll::Pending;
            };
            // SAFETY: the contract. Listed with its process before the priority is read, and in the
            // list of this wait point's lock.
            changed = unsafe {
                Entry::begin(entry, NonNull::from(self), inheritor.take());
                let node = Entry::node(entry);
                lists.senders.insert(node, current::priority(), wake_handle);
                // A plain thread's is known to its inheritor.
                self.requeue(&mut lists, entry);
                self.relend(&lists)
            };
            Poll::Pending
        });
        if listed.is_ready() {
            return Poll::Ready(());
        }
        chain::follow(changed);
        self.wait_point.waits();
        Poll::Pending
    }

    /// Whether the mutex was handed to a listed entry; otherwise the poller's waker from `cx` is
    /// woken then.
    ///
    /// # Safety
    ///
    /// `entry` is the caller's, and was listed here.
    pub(super) unsafe fn poll_listed(&self, entry: NonNull<Entry>, cx: &Context<'_>) -> Poll<()> {
        // SAFETY: the contract; under the lock a waiting node may be changed.
        unsafe {
            if Entry::outcome(entry) == Outcome::Done {
                return Poll::Ready(());
            }
            let mut renewal = Renewal::of(cx);
            let polled = renewal.put(|renewal| {
                let _lists = self.wait_point.lock();
                if Entry::outcome(entry) == Outcome::Done {
                    return Poll::Ready(());
                }
                Entry::renew_wake_handle(entry, renewal);
                Poll::Pending
            });
            if polled.is_pending() {
                self.wait_point.waits();
            }
            polled
        }
    }

    /// Takes a listed entry back, unless the mutex was handed to it: `true`. Its wake handle is to
    /// be dropped when the entry was ended.
    ///
    /// # Safety
    ///
    /// As for [`poll_listed`](Self::poll_listed).
    #[must_use = "the handle's drop is user code, and the caller's last step"]
    pub(super) unsafe fn withdraw(&self, entry: NonNull<Entry>) -> (bool, Option<WakeHandle>) {
        self.wait_point.waits_no_more();
        let mut lists = self.wait_point.lock();
        // SAFETY: the contract; a node that waits is in the list.
        let (changed, former) = unsafe {
            if Entry::outcome(entry) == Outcome::Done {
                return (true, None);
            }
            lists.senders.remove(Entry::node(entry));
            let former = Entry::take_wake_handle(entry);
            Waiter::settle_stale(Entry::waiter(entry));
            (self.relend(&lists), former)
        };
        drop(lists);
        chain::follow(changed);
        (false, former)
    }

    /// Ceases to hold it: the first waiter holds it from now on. `died`: the holder left it in the
    /// middle.
    pub(super) fn unlock(&self, died: bool) {
        if died || !self.unlock_fast() {
            self.unlock_slow(died);
        }
    }

    /// As [`unlock`](Self::unlock), if no entry waits and the wait point's lock is biased to this
    /// executor. `false`: it is not so, and no state has changed. O(1), without atomic
    /// read-modify-writes.
    fn unlock_fast(&self) -> bool {
        let Some(executor) = current::process(|process| process.map(Process::executor_number))
        else {
            return false;
        };
        // SAFETY: the current process is polled on the thread of its executor.
        let Some(mut lists) = (unsafe { self.wait_point.lock_if_biased(executor) }) else {
            return false;
        };
        if !lists.senders.is_empty() {
            return false;
        }
        let former = self.state(&lists, |state| {
            state.is_held = false;
            state.inheritor.take()
        });
        lists.receiver = LastUser::NONE;
        drop(lists);
        if let Some(inheritor) = former {
            give_back(Some(inheritor));
        }
        true
    }

    #[inline(never)]
    fn unlock_slow(&self, died: bool) {
        let mut lists = self.wait_point.lock();
        if died {
            self.set_died(true);
        }
        let former = self.state(&lists, |state| state.inheritor.take());
        let Some(node) = lists.senders.pop() else {
            self.state(&lists, |state| state.is_held = false);
            lists.receiver = LastUser::NONE;
            drop(lists);
            return give_back(former);
        };
        // SAFETY: it was in the list, and the lock is held.
        let next = unsafe { self.hand_over(&mut lists, Entry::of(node)) };
        drop(lists);
        let mut former = former;
        // Also if the next holder's waker panics.
        let _give_back = Finally::new(|| give_back(former.take()));
        next.carry_out();
    }

    /// Makes `entry`, which was just taken off its list, the holder. It is not to be touched after
    /// this.
    ///
    /// # Safety
    ///
    /// `lists` are those of this mutex, which is free; `entry` is in none.
    unsafe fn hand_over(&self, lists: &mut WaitQueues, entry: NonNull<Entry>) -> Admitted {
        // SAFETY: the contract: the node is live until it is settled.
        unsafe {
            let inheritor = Entry::take_inheritor(entry);
            lists.receiver = LastUser::of(Entry::node(entry).as_ref().user());
            self.state(lists, |state| {
                state.is_held = true;
                state.inheritor = inheritor;
            });
            Admitted {
                changed: self.relend(lists),
                ready: Waiter::settle(Entry::waiter(entry), Outcome::Done),
            }
        }
    }

    /// Takes in an entry that waited at a condition: it holds the mutex, or waits for it.
    ///
    /// # Safety
    ///
    /// `entry` was begun for this mutex, is in no list, and its future is kept by the condition's
    /// lock.
    pub(super) unsafe fn admit(&self, entry: NonNull<Entry>) -> Admitted {
        let mut lists = self.wait_point.lock();
        // SAFETY: the contract.
        unsafe {
            if !self.state(&lists, |state| state.is_held) {
                return self.hand_over(&mut lists, entry);
            }
            lists
                .senders
                .insert_again_at(Entry::node(entry), Entry::priority(entry));
            Admitted {
                ready: PendingWake::NONE,
                changed: self.relend(&lists),
            }
        }
    }

    /// Moves `entry`, if it still waits here, to where its process' priority belongs now. Returns
    /// the holder, if its boost changes by that. O(waiters).
    pub(super) fn reorder(&self, entry: NonNull<Entry>) -> Option<Inheritor> {
        let mut lists = self.wait_point.lock();
        let mut next = lists.senders.first();
        while let Some(node) = next {
            // SAFETY: the node is in the list, and the lock is held.
            unsafe {
                if Entry::of(node) == entry {
                    self.requeue(&mut lists, entry);
                    return self.relend(&lists).map(|changed| changed.inheritor);
                }
                next = lists.senders.after(node);
            }
        }
        None
    }

    /// Moves a listed entry to where its priority now belongs. O(1) if it stands there, else
    /// O(waiters of lower priority).
    ///
    /// # Safety
    ///
    /// `entry` is in the list of senders of `lists`, which are this mutex's.
    unsafe fn requeue(&self, lists: &mut WaitQueues, entry: NonNull<Entry>) {
        let node = Entry::node(entry);
        // SAFETY: the contract.
        unsafe {
            let priority = Entry::priority(entry);
            if priority != node.as_ref().priority() {
                lists.senders.remove(node);
                lists.senders.insert_again_at(node, priority);
            }
        }
    }

    /// Boosts the holder to the priority of the first other waiter. O(1), and O(waiters before that
    /// are branches of the holder itself).
    fn relend(&self, lists: &WaitQueues) -> Option<Changed> {
        self.state(lists, |state| {
            let inheritor = state.inheritor.as_mut()?;
            // As a whole: the waiter may be another branch of the same process. The process does
            // not inherit its own priority, since it may be an inherited one.
            let change = inheritor.boost_whole(first_other(lists, inheritor));
            change.is_ne().then(|| Changed {
                inheritor: inheritor.copy(),
                is_more: change.is_gt(),
            })
        })
    }
}

/// Ends the boost of a former holder.
fn give_back(former: Option<Inheritor>) {
    if let Some(mut inheritor) = former
        && inheritor.give_back()
    {
        let is_more = false;
        chain::follow(Some(Changed { inheritor, is_more }));
    }
}

/// The priority of the first waiter that is not the holder itself.
fn first_other(lists: &WaitQueues, holder: &Inheritor) -> Priority {
    let mut next = lists.senders.first();
    while let Some(node) = next {
        // SAFETY: a listed node is live, and an entry's; the lists show that the lock is held.
        unsafe {
            if !Entry::is_of(Entry::of(node), holder) {
                return node.as_ref().priority();
            }
            next = lists.senders.after(node);
        }
    }
    Priority::default()
}
