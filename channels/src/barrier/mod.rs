//! Barriers: several processes wait until all of them have come.
//!
//! The last party completes the round. Under the barrier's lock it counts the round up and moves
//! all waiting parties to the list of those to release, both in O(1). Then it releases them one by
//! one, each in a critical section of its own: the most urgent first, then those that offered the
//! barrier in alternatives. A party that is polled before its turn sees by the round's number that
//! it may go, and takes itself off. Parties of this very executor are woken under the lock, by
//! stores to its run queue, so a bounded number of them is released in one section.
//!
//! An alternative that offers the barrier is a party that may change its mind. The last party
//! therefore takes the commit locks of all such parties, in the order of the addresses of their
//! select states, so that none can choose another guard meanwhile. It takes those off the list that
//! have chosen already, and completes the round only if there are enough without them. O(parties),
//! and no retry: a party that is missing now comes back itself, and then is the last. (JCSP
//! coordinates its alting barriers under one lock for the whole program: P. H. Welch et al.,
//! "Alting Barriers: synchronisation with choice in Java using JCSP", 2010. Here unrelated barriers
//! do not meet.)

mod sync;

pub use sync::SyncOp;

use crate::finally::Finally;
use crate::guarded_wait_point::{GuardedWaitPoint, Locked};
use crate::inspect::WaitPointKind;
use crate::select_state::SelectState;
use crate::stamp::Stamp;
use crate::wait_point::Lists;
use crate::waiter::{Outcome, Waiter};
use luna_core::current::{self, Here, PendingWake, User};
use luna_core::deferred_free::Shared;
use luna_core::wait_list::WaitList;

/// The most parties that are released in one critical section.
const TOGETHER: usize = 16;

/// How far a barrier is. Guarded by its lock.
#[derive(Debug)]
struct Round {
    /// Number of parties that must come.
    parties: usize,
    /// Number of parties that have come, and wait.
    arrived: usize,
    /// How many alternatives offer it.
    offering: usize,
    /// Number of completed rounds. A party that waits with another number may go.
    number: u32,
}

/// What the handles share.
///
/// # Invariants
///
/// All nodes in the wait point's lists are waiters of `()`; those of alternatives lead to select
/// states that were opened for several commits, each to another one. A node's `ticket` is the round
/// that it waits in.
type BarrierPoint = GuardedWaitPoint<Round>;

/// A meeting point of several processes: each `sync` waits until all parties have come.
///
/// Clones are handles to the same barrier, not parties: [`new`](Self::new) sets how many must come,
/// and [`enroll`](Self::enroll) and [`resign`](Self::resign) change it. Parties may be processes of
/// any executor, OS threads, and tasks of other runtimes. For many parties on one executor,
/// [`local`](Self::local) makes a second level that costs no atomics.
///
/// ```
/// use luna_channels::Barrier;
///
/// let barrier = Barrier::new(2);
/// let other = barrier.clone();
/// let sync = async move { other.sync().await };
/// let thread = std::thread::spawn(move || luna_core::block_on(sync));
/// // returns when both have come
/// luna_core::block_on(async { barrier.sync().await }).unwrap();
/// thread.join().unwrap().unwrap();
/// ```
pub struct Barrier {
    point: Shared<BarrierPoint>,
    chosen: Stamp,
}

impl core::panic::UnwindSafe for Barrier {}
impl core::panic::RefUnwindSafe for Barrier {}

impl Barrier {
    /// A barrier of `parties`. With none, a `sync` returns at once until a party enrolls.
    /// Allocates; not for the real-time path.
    #[track_caller]
    pub fn new(parties: usize) -> Barrier {
        let round = Round {
            parties,
            arrived: 0,
            offering: 0,
            number: 0,
        };
        Barrier {
            point: GuardedWaitPoint::share(WaitPointKind::Barrier, round),
            chosen: Stamp::new(),
        }
    }

    /// Comes to the barrier, and waits until all parties have come. As a guard, comes only if all
    /// others have come.
    ///
    /// In a branch of a parallel construct, after a sibling has failed, it does not wait: the
    /// branch ends there as poisoned. Cancel-safe: dropped while it waits, the party has not come;
    /// after the round was completed, it has. Real-time path: yes; no allocation, O(1) to wait
    /// (O(waiting parties of lower priority)), O(parties) for the last one, each in a critical
    /// section of its own. Parties that offer the barrier in alternatives cost each arriving party
    /// O(their number) more under one lock.
    #[inline]
    pub fn sync(&self) -> SyncOp<'_> {
        SyncOp::new(self)
    }

    /// Becomes one more party, until what this returns is dropped. O(1). In the middle of a round,
    /// that round waits for it too.
    pub fn enroll(&self) -> Party {
        self.point.lock().state().parties += 1;
        Party::new(self.clone())
    }

    /// Removes one of the parties that [`new`](Self::new) counted. If all others have come, the
    /// round is complete. O(parties) then. A barrier without parties stays one.
    pub fn resign(&self) {
        self.point.resign();
    }

    /// Number of parties that must come: for display, since it may have changed already.
    pub fn parties(&self) -> usize {
        self.point.lock().state().parties
    }

    /// Puts a group of `parties` processes in the place of one party that [`new`](Self::new)
    /// counted. Each member comes to the barrier itself; the group's barrier is this one.
    ///
    /// ```
    /// use luna_channels::Barrier;
    /// use luna_core::{Executor, ProcessSpec};
    /// use luna_platform::thread::Attributes;
    ///
    /// let barrier = Barrier::new(2); // the group, and this thread
    /// let group = barrier.local(3);
    /// let executor = Executor::start(Attributes::new("group"))?;
    /// for _ in 0..3 {
    ///     let group = group.clone();
    ///     executor.spawn(ProcessSpec::new("member"), move || async move { group.sync().await });
    /// }
    /// executor.release();
    /// luna_core::block_on(barrier.sync()).unwrap();
    /// executor.stop();
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn local(&self, parties: usize) -> Barrier {
        self.point.lock().state().parties += parties.saturating_sub(1);
        self.clone()
    }

    /// Declares that a party is outside of the system: a plain thread, or a process of another
    /// system. A process that waits here is then never part of a deadlock. A barrier that an
    /// outside thread has used already, also one that runs a body by `luna::run`, is known to have
    /// such a party. Has no other effect.
    ///
    /// ```
    /// let barrier = luna_channels::Barrier::new(2).external().named("start");
    /// let points = luna_channels::inspect::wait_points();
    /// assert!(points.iter().any(|point| point.external && point.name.as_deref() == Some("start")));
    /// # drop(barrier);
    /// ```
    #[must_use]
    pub fn external(self) -> Self {
        self.point.identity.set_external();
        self
    }

    /// Names the barrier in reports: see [`inspect`](crate::inspect). Not for the real-time path.
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        self.point.identity.set_name(name);
        self
    }
}

impl Clone for Barrier {
    fn clone(&self) -> Self {
        Barrier {
            point: self.point.clone(),
            chosen: Stamp::new(),
        }
    }
}

luna_platform::debug_fields!(Barrier, |barrier| shared: &raw const *barrier.point);

impl BarrierPoint {
    /// Remembers that a party is unknown to every system: from outside, or a thread of its own.
    fn note_user(&self) {
        let user = current::user();
        self.note_outsider(user);
        if user != User::Outside && !current::on_path() {
            self.identity.set_stranger();
        }
    }

    fn resign(&self) {
        let mut point = self.lock();
        let round = point.state();
        round.parties = round.parties.saturating_sub(1);
        let is_complete = point.complete_with(0);
        drop(point);
        if is_complete {
            self.release();
        }
    }

    /// Releases members of completed rounds, and unlocks: those of this executor under the lock, up
    /// to a bounded number, and another one without. `false`: there are no more. O(1).
    #[inline(always)]
    fn release_some(&self, mut locked: Locked<'_, Round, impl Lists>, here: Here<'_>) -> bool {
        let mut left = TOGETHER;
        let released = locked.released();
        // SAFETY: the lock is held, so what is in the list is a live waiter that waits. It is
        // settled after it was taken off, and not touched then.
        unsafe {
            while left > 0
                && let Some(first) = released.first()
                && Waiter::wake_here(first.cast::<Waiter<()>>(), here)
            {
                released.remove_first(first);
                Waiter::set_outcome(first.cast::<Waiter<()>>(), Outcome::Done);
                left -= 1;
            }
        }
        let Some(node) = released.pop() else {
            return false;
        };
        // SAFETY: it was in the list, so it is a live waiter, and the lock is held.
        let ready = unsafe { Waiter::settle(node.cast::<Waiter<()>>(), Outcome::Done) };
        drop(locked);
        self.wake(ready);
        true
    }

    #[inline(never)]
    fn wake(&self, ready: PendingWake) {
        // A wake may panic: the remaining wakes must still be done.
        let rest = Finally::new(|| self.release());
        ready.wake();
        rest.cancel();
    }

    /// Releases all members of completed rounds. O(their number), in critical sections of O(1).
    #[inline(never)]
    fn release(&self) {
        let here = Here::now();
        while self.release_some(self.lock_in(here), here) {}
    }
}

/// The parties that wait are in the lists of any wait point, under other names.
impl<L: Lists> Locked<'_, Round, L> {
    /// Those that have come in this round, by priority.
    #[inline(always)]
    fn arrived(&mut self) -> &mut WaitList {
        &mut self.senders
    }

    /// The alternatives that offer the barrier, by the addresses of their select states.
    #[inline(always)]
    fn offering(&mut self) -> &mut WaitList {
        &mut self.receivers
    }

    /// The members of completed rounds, which are to be woken.
    #[inline(always)]
    fn released(&mut self) -> &mut WaitList {
        &mut self.held
    }

    /// Whether another party than the one that comes now is missing.
    #[inline(always)]
    fn is_missing_more(&mut self) -> bool {
        let round = self.state();
        round.arrived + round.offering + 1 < round.parties
    }

    /// Completes the round if enough have come together with `more` unlisted parties. The waiting
    /// parties are then to be [released](BarrierPoint::release), without the lock. O(parties that
    /// are alternatives).
    #[inline]
    fn complete_with(&mut self, more: usize) -> bool {
        let none_waits = self.arrived().is_empty() && self.offering().is_empty();
        let round = self.state();
        let come = round.arrived + round.offering + more;
        if come < round.parties || (more == 0 && none_waits) {
            return false;
        }
        if round.offering > 0 && !self.commit_offering(more) {
            return false;
        }
        let round = self.state();
        round.arrived = 0;
        round.offering = 0;
        round.number = round.number.wrapping_add(1);
        let lists = &mut **self;
        lists.held.append(&mut lists.senders);
        lists.held.append(&mut lists.receivers);
        true
    }

    /// Chooses the barrier in all alternatives that offer it, if they are enough together with the
    /// parties that have come and `more`. Those that have chosen another guard go off the list.
    #[inline(never)]
    fn commit_offering(&mut self, more: usize) -> bool {
        // SAFETY: the lock is held, so the nodes are live waiters, and by `BarrierPoint`'s
        // invariants lead to select states that need their commit lock, each to another one. These
        // are live while their node is listed. So this thread enters each once, in their order, and
        // leaves each once: with a guard only if it was open. A stale one is settled after it was
        // taken off.
        unsafe {
            let mut open = 0;
            let mut next = self.offering().first();
            while let Some(node) = next {
                next = self.offering().after(node);
                let waiter = node.cast::<Waiter<()>>();
                let Some((select_state, guard)) = Waiter::select_state(waiter) else {
                    continue;
                };
                if SelectState::enter(select_state, guard) {
                    open += 1;
                } else {
                    select_state.as_ref().leave(None);
                    self.offering().remove(node);
                    // An alternative's node holds no wake handle until it is chosen.
                    Waiter::set_outcome(waiter, Outcome::Stale);
                }
            }
            let round = self.state();
            round.offering = open;
            let is_enough = round.arrived + open + more >= round.parties;
            for node in self.offering().nodes() {
                let waiter = node.cast::<Waiter<()>>();
                let Some((select_state, guard)) = Waiter::select_state(waiter) else {
                    continue;
                };
                let wake_handle = select_state.as_ref().leave(is_enough.then_some(guard));
                if is_enough {
                    // From now on it waits for its release as all others.
                    *(*Waiter::link(waiter)).wait.wake_handle_mut() = wake_handle;
                    Waiter::leave_select_state(waiter);
                }
            }
            is_enough
        }
    }
}

/// One party of a barrier, until it is dropped: see [`Barrier::enroll`].
///
/// A process that ends, fails or panics takes its party with it, so that the others do not wait for
/// it for ever. Dropping it is O(1), and O(parties) if that completes the round.
///
/// ```
/// use luna_channels::Barrier;
/// # luna_core::block_on(async {
/// let barrier = Barrier::new(0);
/// let party = barrier.enroll();
/// party.sync().await; // alone
/// drop(party);
/// assert_eq!(barrier.parties(), 0);
/// # }).unwrap();
/// ```
#[derive(Debug)]
#[must_use = "the party resigns when this is dropped"]
pub struct Party {
    barrier: Barrier,
}

impl Party {
    pub(super) fn new(barrier: Barrier) -> Self {
        Self { barrier }
    }

    /// As [`Barrier::sync`].
    #[inline]
    pub fn sync(&self) -> SyncOp<'_> {
        self.barrier.sync()
    }
}

impl Drop for Party {
    fn drop(&mut self) {
        self.barrier.resign();
    }
}
