//! One choice among several offers, made under one lock.
//!
//! An alternative lists a node in each of its channels, and all of them lead to one *select state*.
//! A partner that comes to one of these channels commits the select state under the channel's lock.
//! Of all that try, one succeeds, and goes on as with any waiting operation. The others find the
//! choice made, take the stale node off their list, and look at the next waiter.
//!
//! ```text
//!   CLOSED --owner opens, lists nodes--> OPEN --partner or owner--> CHOSEN(guard)
//! ```
//!
//! Every thread that leaves `OPEN` holds the *commit lock* of the select state, and leaves by a
//! plain store. So a partner may commit several select states at once, or close one for its owner.
//! The lock is biased to the executor of the owner where that owns the locks of all wait points: a
//! commit there executes no read-modify-write.
//!
//! No thread waits for another to leave an intermediate state: a commit that fails is final for
//! that node, and the owner that finds its alternative chosen takes the lock of the one channel to
//! learn the outcome.

use core::mem::replace;
use core::ptr::NonNull;
use core::task::Context;
use luna_core::biased_lock::{BiasedGuard, BiasedLock, InsideGuard};
use luna_core::current::{Here, PlainPendingWake, PlainTurn, Priority, User, WakeHandle};
use luna_platform::clock::{Clock, Instant};
use luna_platform::sync::UnsafeCell;
use luna_platform::sync::atomic::{AtomicU32, Ordering};

/// It cannot be committed: the owner does not wait.
const CLOSED: u32 = 0;
/// The first commit succeeds.
const OPEN: u32 = 1;
/// As `OPEN`, by a process in its plain turn on the executor to which the commit lock is biased:
/// the wake handle is a plain one.
const OPEN_PLAINLY: u32 = 2;
/// Guard `state - CHOSEN` was chosen.
const CHOSEN: u32 = 3;

/// The choice of one alternative.
///
/// # Invariants
///
/// `state` is changed under the commit lock, or by the owner while no other thread knows this.
/// In `OPEN` and `OPEN_PLAINLY` there is a wake handle; the thread that leaves them takes it.
/// `entered` belongs to the thread that holds the commit lock. While a node that leads here is
/// listed, this is live: its owner takes each node off, under its list's lock, before it goes.
///
/// A thread holds a commit lock for one step, in which it polls nothing, runs no user code and
/// takes no other lock; a barrier's last party holds those of one queue together, and enters each
/// once. So code that a poll calls, and that has not entered the commit lock, does not hold it.
#[derive(Debug)]
pub struct SelectState {
    state: AtomicU32,
    /// The process that has opened it, and its priority then, if it was opened when it was made.
    opened_by: (User, Priority),
    commit_lock: BiasedLock<Opening>,
    entered: UnsafeCell<Option<BiasedGuard<'static, Opening>>>,
    /// loom repeats a model's run, and addresses differ between runs.
    #[cfg(loom)]
    number: usize,
}

/// What the commit lock guards beside the state.
#[derive(Debug)]
pub(crate) struct Opening {
    wake_handle: Option<WakeHandle>,
    limit: Option<Limit>,
}

/// From when on some guards cannot be committed: a delay before them in the order of preference has
/// passed then, and the owner chooses that delay, though it may not have run yet.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limit {
    pub(crate) instant: Instant,
    /// These guards are those from this number on.
    pub(crate) first_late: u32,
    /// The clock of `instant`: a partner with another clock cannot compare.
    pub(crate) clock: usize,
}

impl Limit {
    #[cold]
    #[inline(never)]
    fn excludes(&self, guard: u32) -> bool {
        guard >= self.first_late
            && self.clock == Clock::number_here()
            && Instant::now() >= self.instant
    }
}

impl Opening {
    /// Whether a delay that is preferred to `guard` has passed.
    #[inline(always)]
    fn is_late(&self, guard: u32) -> bool {
        self.limit.is_some_and(|limit| limit.excludes(guard))
    }
}

/// The owner of an alternative that is about to wait: its wake handle, and how it holds locks.
pub(crate) trait Owner {
    /// An open select state, which its partners have to find by nodes.
    fn open(self, limit: Option<Limit>) -> SelectState;
}

/// In a plain turn: the commit lock is biased to its executor.
impl Owner for PlainTurn<'_> {
    #[inline(always)]
    fn open(self, limit: Option<Limit>) -> SelectState {
        let process = self.process();
        let opening = Opening {
            wake_handle: Some(WakeHandle::of_plain_turn(self)),
            limit,
        };
        let commit_lock = BiasedLock::biased_in(self.here(), opening);
        let opened_by = (User::Process(process.id()), process.priority());
        SelectState::with(OPEN_PLAINLY, opened_by, commit_lock)
    }
}

/// Anywhere, with a handle that was made before the locks were taken.
impl Owner for (Here<'_>, &mut Option<WakeHandle>) {
    fn open(self, limit: Option<Limit>) -> SelectState {
        let (here, wake_handle) = self;
        let wake_handle = wake_handle.take();
        debug_assert!(wake_handle.is_some());
        let opening = Opening { wake_handle, limit };
        let opened_by = (here.user(), here.priority());
        SelectState::with(OPEN, opened_by, BiasedLock::new(opening))
    }
}

impl SelectState {
    /// Whether one that is not open has anything to drop.
    pub(crate) const HAS_DROP: bool = core::mem::needs_drop::<BiasedLock<()>>();

    #[inline(always)]
    fn with(state: u32, opened_by: (User, Priority), commit_lock: BiasedLock<Opening>) -> Self {
        Self {
            state: AtomicU32::new(state),
            opened_by,
            commit_lock,
            entered: UnsafeCell::new(None),
            #[cfg(loom)]
            number: {
                static NEXT: core::sync::atomic::AtomicUsize =
                    core::sync::atomic::AtomicUsize::new(0);
                NEXT.fetch_add(1, core::sync::atomic::Ordering::Relaxed)
            },
        }
    }

    /// A closed one, which its owner opens and closes again and again.
    pub(crate) fn new() -> Self {
        let opening = Opening {
            wake_handle: None,
            limit: None,
        };
        let opened_by = (User::Outside, Priority::default());
        Self::with(CLOSED, opened_by, BiasedLock::new(opening))
    }

    /// The process that opened it when it was made, and its priority then.
    pub(crate) fn opened_by(&self) -> (User, Priority) {
        self.opened_by
    }

    /// Takes the commit lock for one step. The owner decides what else the lock guards beside the
    /// state.
    #[inline]
    pub(crate) fn commit_lock(&self) -> BiasedGuard<'_, Opening> {
        self.commit_lock.lock()
    }

    /// As [`commit_lock`](Self::commit_lock), if it is biased to this executor.
    #[inline(always)]
    pub(crate) fn commit_lock_if_biased(&self, here: Here<'_>) -> Option<InsideGuard<'_, Opening>> {
        self.commit_lock.enter_in(here)
    }

    /// Opens a closed one. `opening` is what its commit lock guards.
    pub(crate) fn open_again(&self, opening: &mut Opening, wake_handle: WakeHandle) {
        // A thread that has closed it for the owner has taken the former one.
        debug_assert!(opening.wake_handle.is_none());
        opening.wake_handle = Some(wake_handle);
        self.state.store(OPEN, Ordering::Release);
    }

    /// As [`open_again`](Self::open_again), for the process in its plain turn. The commit lock is
    /// held by its bias to the executor of this turn.
    #[inline(always)]
    pub(crate) fn open_plainly(&self, opening: &mut InsideGuard<'_, Opening>, turn: PlainTurn<'_>) {
        let wake_handle = Some(WakeHandle::of_plain_turn(turn));
        // Not dropped: there is none, as `open_again` says.
        core::mem::forget(replace(&mut opening.wake_handle, wake_handle));
        self.state.store(OPEN_PLAINLY, Ordering::Release);
    }

    /// Chooses `guard`, if the select state was opened plainly: returns the owner's pending wake.
    /// For partners, as [`commit`](Self::commit).
    ///
    /// # Safety
    ///
    /// `opening` is what this commit lock guards, held by the executor that owns its bias.
    #[inline(always)]
    pub(crate) unsafe fn commit_plainly(
        &self,
        opening: &mut InsideGuard<'_, Opening>,
        guard: u32,
    ) -> Option<PlainPendingWake> {
        if self.state.load(Ordering::Acquire) != OPEN_PLAINLY || opening.is_late(guard) {
            return None;
        }
        // SAFETY: the commit lock is held, and the state is about to be left. In `OPEN_PLAINLY`
        // there is a plain wake handle, made by the executor that owns the bias: on this thread. It
        // is overwritten, not dropped, after it was read.
        let ready = unsafe {
            let ready = WakeHandle::plain_of(&raw const opening.wake_handle);
            (&raw mut opening.wake_handle).write(None);
            ready
        };
        self.state
            .store(guard.saturating_add(CHOSEN), Ordering::Release);
        Some(ready)
    }

    /// Whether it is open and would not wake the process of this poll.
    pub(crate) fn wakes_another(&self, cx: &Context<'_>) -> bool {
        let opening = self.commit_lock.lock();
        let wake_handle = opening.wake_handle.as_ref();
        self.is_open() && wake_handle.is_some_and(|wake_handle| !wake_handle.is_of(cx))
    }

    /// Gives the owner of an open one another wake handle; returns the handle that is not used any
    /// more, or `wake_handle` if it is not open. Its drop is user code.
    pub(crate) fn replace_wake_handle(&self, wake_handle: WakeHandle) -> Option<WakeHandle> {
        let mut opening = self.commit_lock.lock();
        if !self.is_open() {
            return Some(wake_handle);
        }
        self.state.store(OPEN, Ordering::Release);
        opening.wake_handle.replace(wake_handle)
    }

    /// Number of the chosen guard, if any. Acquire: all before the commit is visible.
    #[inline]
    pub(crate) fn chosen(&self) -> Option<u32> {
        self.state.load(Ordering::Acquire).checked_sub(CHOSEN)
    }

    /// Whether nothing is chosen and its owner waits.
    #[inline]
    pub(crate) fn is_open(&self) -> bool {
        matches!(self.state.load(Ordering::Acquire), OPEN | OPEN_PLAINLY)
    }

    /// Chooses `guard`, if nothing is chosen yet: returns the owner's pending wake.
    ///
    /// For partners, under the lock of the list in which they found a node that leads here.
    #[inline]
    pub(crate) fn commit(&self, guard: u32) -> Option<WakeHandle> {
        if !self.is_open() {
            return None;
        }
        let mut opening = self.commit_lock.lock();
        if opening.is_late(guard) {
            return None;
        }
        self.leave_open(&mut opening, guard.saturating_add(CHOSEN))
    }

    /// As [`commit`](Self::commit), by the owner for a guard of its own after its time has come.
    /// The owner need not be woken.
    #[must_use = "the handle's drop is user code, and the owner's last step"]
    pub(crate) fn commit_own(&self, guard: u32) -> Option<WakeHandle> {
        self.leave_open(&mut self.commit_lock.lock(), guard.saturating_add(CHOSEN))
    }

    /// Withdraws the choice from all partners, if nothing is chosen yet: returns the owner's wake
    /// handle.
    #[must_use = "the handle's drop is user code, and the owner's last step"]
    pub(crate) fn close(&self) -> Option<WakeHandle> {
        self.leave_open(&mut self.commit_lock.lock(), CLOSED)
    }

    /// Leaves an open state for `state`, under the commit lock: returns the wake handle.
    #[inline]
    fn leave_open(&self, opening: &mut Opening, state: u32) -> Option<WakeHandle> {
        if !self.is_open() {
            return None;
        }
        let wake_handle = opening.wake_handle.take();
        self.state.store(state, Ordering::Release);
        wake_handle
    }

    /// The order in which several commit locks are taken: that of the addresses.
    ///
    /// # Safety
    ///
    /// `this` is live.
    pub(crate) unsafe fn order(this: NonNull<SelectState>) -> usize {
        #[cfg(loom)]
        // SAFETY: the select state is live, as is demanded here; its number never changes.
        return unsafe { this.as_ref() }.number;
        #[cfg(not(loom))]
        this.addr().get()
    }

    /// Takes the commit lock: until [`leave`](Self::leave), no other thread commits. Returns
    /// whether `guard` can be chosen.
    ///
    /// A thread that takes several commit locks does so in their [`order`](Self::order).
    ///
    /// # Safety
    ///
    /// `this` is live until `leave`, and this thread has not entered it.
    pub(crate) unsafe fn enter(this: NonNull<SelectState>, guard: u32) -> bool {
        // SAFETY: by `# Safety` it is live until `leave`, which drops the guard that borrows it: so
        // the longer lifetime is not relied on.
        let select_state: &'static SelectState = unsafe { this.as_ref() };
        let commit_lock = select_state.commit_lock.lock();
        let is_late = commit_lock.is_late(guard);
        // SAFETY: the commit lock is this thread's.
        select_state
            .entered
            .with_mut(|cell| unsafe { *cell = Some(commit_lock) });
        select_state.is_open() && !is_late
    }

    /// Leaves the commit lock; before that, chooses `guard` if one is given, and returns the
    /// owner's pending wake.
    ///
    /// # Safety
    ///
    /// This thread has entered it. With a guard, it was open then.
    pub(crate) unsafe fn leave(&self, guard: Option<u32>) -> Option<WakeHandle> {
        // SAFETY: this thread has entered it, so the commit lock is its own.
        let mut opening = self.entered.with_mut(|cell| unsafe { (*cell).take() })?;
        self.leave_open(&mut opening, guard?.saturating_add(CHOSEN))
    }
}
