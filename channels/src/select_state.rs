//! One choice among several offers, made by one compare-and-swap, or under a lock.
//!
//! An alternative lists a node in each of its channels, and all of them lead to one *select state*.
//! A partner that comes to one of these channels commits the select state under the channel's lock.
//! Of all that try, one succeeds, and goes on as with any waiting operation. The others find the
//! choice made, take the stale node off their list, and look at the next waiter.
//!
//! ```text
//!   CLOSED --owner opens, lists nodes--> OPEN --partner or owner, one exchange--> CHOSEN(guard)
//! ```
//!
//! A compare-and-swap does not suffice if a partner may commit several select states at once, or
//! close this one for its owner. Then every thread that leaves `OPEN` holds the *commit lock* of
//! the select state, and leaves by a plain store. The fast path does the same: the commit lock is
//! biased to an executor, so a commit there executes no read-modify-write. The mode does not change
//! between an opening and the end of that opening.
//!
//! No thread waits for another to leave an intermediate state: a commit that fails is final for
//! that node, and the owner that finds its alternative chosen takes the lock of the one channel to
//! learn the outcome.

use core::ptr::NonNull;
use luna_core::biased_lock::{BiasedGuard, BiasedLock, InsideGuard};
use luna_core::current::{PlainPendingWake, PlainTurn, Priority, User, WakeHandle};
use luna_platform::clock::{Clock, Instant};
use luna_platform::sync::UnsafeCell;
use luna_platform::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, AtomicUsize, Ordering};

/// It cannot be committed: the owner does not wait.
const CLOSED: u32 = 0;
/// The first commit succeeds.
const OPEN: u32 = 1;
/// As `OPEN`, by a process in its plain turn on the executor to which the commit lock is biased:
/// the wake handle is a plain one, commits need the commit lock, and no delay limits them.
const OPEN_PLAINLY: u32 = 2;
/// Guard `state - CHOSEN` was chosen.
const CHOSEN: u32 = 3;

/// The choice of one alternative.
///
/// # Invariants
///
/// `wake_handle` belongs to the owner unless the state is `OPEN` or `OPEN_PLAINLY`; from these, to
/// the thread that left them. Where another thread closes it without a choice
/// ([`close`](SelectState::close)), the owner could see that before the other thread has taken the
/// wake handle, and open it again. So such select states are `needs_lock`: the commit lock is held
/// around both. `needs_lock` is changed by the owner alone, while no listed node leads here.
/// `entered` belongs to the thread that holds the commit lock. While a node that leads here is
/// listed, this is live: its owner takes each node off, under its list's lock, before it goes.
///
/// A thread holds a commit lock for one step, in which it polls nothing, runs no user code and
/// takes no other lock; a barrier's last party holds those of one queue together, and enters each
/// once. So code that a poll calls, and that has not entered the commit lock, does not hold it.
#[derive(Debug)]
pub struct SelectState {
    state: AtomicU32,
    /// Whether a thread that leaves `OPEN` holds the commit lock: a barrier's last party may commit
    /// several select states at once, a partner may close this one for its owner, or all wait
    /// points are biased to one executor.
    needs_lock: AtomicBool,
    /// The guards from `first_late` on cannot be committed from this instant on, in nanoseconds: a
    /// delay before them in the order of preference has passed then, and the owner chooses that
    /// delay, though it may not have run yet.
    late_from: AtomicU64,
    first_late: AtomicU32,
    /// The clock of `late_from`: a partner with another clock cannot compare.
    clock: AtomicUsize,
    wake_handle: UnsafeCell<Option<WakeHandle>>,
    /// The process that has opened it on the fast path, and its priority then.
    opened_by: (User, Priority),
    /// The commit lock. Held around each commit where `needs_lock` is set, so that a barrier's last
    /// party sees all select states that it commits open at one instant.
    commit_lock: BiasedLock<()>,
    entered: UnsafeCell<Option<BiasedGuard<'static, ()>>>,
    /// loom repeats a model's run, and addresses differ between runs.
    #[cfg(loom)]
    number: usize,
}

impl SelectState {
    /// Whether one that is not open has anything to drop.
    pub(crate) const HAS_DROP: bool = core::mem::needs_drop::<BiasedLock<()>>();

    #[inline]
    pub(crate) fn new() -> Self {
        Self {
            state: AtomicU32::new(CLOSED),
            needs_lock: AtomicBool::new(false),
            late_from: AtomicU64::new(u64::MAX),
            first_late: AtomicU32::new(0),
            clock: AtomicUsize::new(0),
            wake_handle: UnsafeCell::new(None),
            opened_by: (User::Outside, Priority::default()),
            commit_lock: BiasedLock::new(()),
            entered: UnsafeCell::new(None),
            #[cfg(loom)]
            number: {
                static NEXT: core::sync::atomic::AtomicUsize =
                    core::sync::atomic::AtomicUsize::new(0);
                NEXT.fetch_add(1, core::sync::atomic::Ordering::Relaxed)
            },
        }
    }

    /// Lets others commit it from now on; they then wake `wake_handle`. With a `limit`, the guards
    /// from its number on can be committed until its instant only.
    ///
    /// # Safety
    ///
    /// The owner calls this, and the select state is closed.
    pub(crate) unsafe fn open(
        &self,
        wake_handle: WakeHandle,
        several: bool,
        limit: Option<(Instant, u32)>,
    ) {
        self.needs_lock.store(several, Ordering::Relaxed);
        if let Some((instant, first_late)) = limit {
            self.first_late.store(first_late, Ordering::Relaxed);
            self.clock.store(Clock::number_here(), Ordering::Relaxed);
            self.late_from.store(instant.as_nanos(), Ordering::Relaxed);
        }
        // SAFETY: in a closed select state it is the owner's; no thread closes this one for the
        // owner before it was opened.
        self.wake_handle
            .with_mut(|cell| unsafe { *cell = Some(wake_handle) });
        self.state.store(OPEN, Ordering::Release);
    }

    /// An [open](Self::open) one, for the process in its plain turn, where all wait points are
    /// biased to its executor: the commit lock is too.
    #[inline(always)]
    pub(crate) fn opened_fast(turn: PlainTurn<'_>) -> Self {
        Self {
            state: AtomicU32::new(OPEN_PLAINLY),
            needs_lock: AtomicBool::new(true),
            wake_handle: UnsafeCell::new(Some(WakeHandle::of_plain_turn(turn))),
            opened_by: (
                User::Process(turn.process().id()),
                turn.process().priority(),
            ),
            commit_lock: BiasedLock::biased_in(turn.here(), ()),
            ..Self::new()
        }
    }

    /// The process that has [opened it on the fast path](Self::opened_fast), and its priority then.
    pub(crate) fn opened_by(&self) -> (User, Priority) {
        self.opened_by
    }

    /// Makes commits need the commit lock, for good: for a select state that others may close.
    pub(crate) fn require_lock(&mut self) {
        self.needs_lock.store(true, Ordering::Relaxed);
    }

    /// Takes the commit lock for one step. The owner decides what else the lock guards beside the
    /// state.
    #[inline]
    pub(crate) fn commit_lock(&self) -> BiasedGuard<'_, ()> {
        self.commit_lock.lock()
    }

    /// As [`commit_lock`](Self::commit_lock), if it is biased to this executor.
    ///
    /// # Safety
    ///
    /// The calling thread does not hold the commit lock.
    #[inline(always)]
    pub(crate) unsafe fn commit_lock_if_biased(
        &self,
        turn: PlainTurn<'_>,
    ) -> Option<InsideGuard<'_, ()>> {
        // SAFETY: the calling thread does not hold the commit lock, as is demanded here: all that
        // the lock demands.
        self.commit_lock.enter_in(turn.here())
    }

    /// Opens a select state that needs its commit lock for good.
    ///
    /// # Safety
    ///
    /// The owner calls this, the select state is closed, and the commit lock is held.
    pub(crate) unsafe fn open_with_lock(&self, wake_handle: WakeHandle) {
        // SAFETY: in a closed select state it is the owner's; a thread that has closed it for the
        // owner has left the commit lock.
        self.wake_handle
            .with_mut(|cell| unsafe { *cell = Some(wake_handle) });
        self.state.store(OPEN, Ordering::Release);
    }

    /// As [`open_with_lock`](Self::open_with_lock), for the process in its plain turn.
    ///
    /// # Safety
    ///
    /// As for `open_with_lock`; and the commit lock is biased to the executor of this turn.
    #[inline]
    pub(crate) unsafe fn open_plainly(&self, turn: PlainTurn<'_>) {
        let wake_handle = Some(WakeHandle::of_plain_turn(turn));
        // SAFETY: in a closed select state the wake handle is the owner's, and a thread that has
        // closed it for the owner has left the commit lock, which is held here. The former handle
        // is not dropped: it could be left here only by an opening that no thread has left, and
        // there is none.
        self.wake_handle
            .with_mut(|cell| unsafe { cell.write(wake_handle) });
        self.state.store(OPEN_PLAINLY, Ordering::Release);
    }

    /// Chooses `guard`, if the select state was opened [plainly](Self::open_plainly): returns the
    /// owner's pending wake.
    ///
    /// # Safety
    ///
    /// The commit lock is held by the executor that owns its bias. This is a partner, as for
    /// [`commit`](Self::commit).
    #[inline(always)]
    pub(crate) unsafe fn commit_plainly(&self, guard: u32) -> Option<PlainPendingWake> {
        if self.state.load(Ordering::Acquire) != OPEN_PLAINLY {
            return None;
        }
        let ready = self.wake_handle.with_mut(|cell| {
            // SAFETY: the commit lock is held, and the state is about to be left. In
            // `OPEN_PLAINLY` there is a plain wake handle, made by the executor that owns the bias:
            // on this thread. It is overwritten, not dropped, after it was read.
            unsafe {
                let ready = WakeHandle::plain_of(cell);
                cell.write(None);
                ready
            }
        });
        self.state
            .store(guard.saturating_add(CHOSEN), Ordering::Release);
        Some(ready)
    }

    /// Replaces the wake handle, and returns the former one.
    ///
    /// # Safety
    ///
    /// The owner calls this, and no thread can commit the select state meanwhile: it is closed, or
    /// the owner holds the locks of all lists that its nodes are in.
    pub(crate) unsafe fn replace_wake_handle(&self, wake_handle: WakeHandle) -> Option<WakeHandle> {
        if self.state.load(Ordering::Relaxed) == OPEN_PLAINLY {
            // Release: the owner's next store of the wake handle follows under the same locks.
            self.state.store(OPEN, Ordering::Release);
        }
        // SAFETY: the wake handle of an open select state belongs to the thread that leaves that
        // state. By `# Safety` no thread can do so meanwhile, so it is the owner's.
        self.wake_handle
            .with_mut(|cell| unsafe { (*cell).replace(wake_handle) })
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
    pub(crate) fn commit(&self, guard: u32) -> Option<Option<WakeHandle>> {
        if !self.is_open() || self.is_late(guard) {
            return None;
        }
        self.leave_open(guard.saturating_add(CHOSEN))
    }

    /// As [`commit`](Self::commit), by the owner for a guard of its own after its time has come.
    /// The owner need not be woken.
    #[must_use = "the handle's drop is user code, and the owner's last step"]
    pub(crate) fn commit_own(&self, guard: u32) -> Option<WakeHandle> {
        self.leave_open(guard.saturating_add(CHOSEN)).flatten()
    }

    /// Whether a delay that is preferred to `guard` has passed.
    #[inline(always)]
    fn is_late(&self, guard: u32) -> bool {
        let late_from = self.late_from.load(Ordering::Relaxed);
        late_from != u64::MAX && self.is_past(late_from, guard)
    }

    #[cold]
    #[inline(never)]
    fn is_past(&self, late_from: u64, guard: u32) -> bool {
        guard >= self.first_late.load(Ordering::Relaxed)
            && self.clock.load(Ordering::Relaxed) == Clock::number_here()
            && Instant::now().as_nanos() >= late_from
    }

    /// Withdraws the choice from all partners, if nothing is chosen yet: returns the owner's wake
    /// handle.
    #[must_use = "the handle's drop is user code, and the owner's last step"]
    pub(crate) fn close(&self) -> Option<Option<WakeHandle>> {
        self.leave_open(CLOSED)
    }

    /// Leaves an open state for `state`: returns the wake handle, if there is one.
    #[inline]
    fn leave_open(&self, state: u32) -> Option<Option<WakeHandle>> {
        if self.needs_lock.load(Ordering::Relaxed) {
            let _commit_lock = self.commit_lock.lock();
            // SAFETY: the commit lock is held.
            return unsafe { self.leave_open_with_lock(state) };
        }
        self.state
            .compare_exchange(OPEN, state, Ordering::AcqRel, Ordering::Relaxed)
            .ok()?;
        // SAFETY: this thread's exchange left `OPEN`, so the wake handle is its own.
        Some(self.wake_handle.with_mut(|cell| unsafe { (*cell).take() }))
    }

    /// As [`leave_open`](Self::leave_open), under the commit lock.
    ///
    /// # Safety
    ///
    /// The select state needs its commit lock, and the calling thread holds it.
    #[inline]
    unsafe fn leave_open_with_lock(&self, state: u32) -> Option<Option<WakeHandle>> {
        if !self.is_open() {
            return None;
        }
        // SAFETY: no other thread leaves an open state while the commit lock is held, so the wake
        // handle is this thread's.
        let wake_handle = self.wake_handle.with_mut(|cell| unsafe { (*cell).take() });
        // After it was taken: the owner, when it sees that the state was left, may open it again.
        self.state.store(state, Ordering::Release);
        Some(wake_handle)
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
    /// `this` needs its commit lock, is live until `leave`, and this thread has not entered it.
    pub(crate) unsafe fn enter(this: NonNull<SelectState>, guard: u32) -> bool {
        // SAFETY: by `# Safety` it is live until `leave`, which drops the guard that borrows it: so
        // the longer lifetime is not relied on.
        let select_state: &'static SelectState = unsafe { this.as_ref() };
        let commit_lock = select_state.commit_lock.lock();
        // SAFETY: the commit lock is this thread's.
        select_state
            .entered
            .with_mut(|cell| unsafe { *cell = Some(commit_lock) });
        select_state.is_open() && !select_state.is_late(guard)
    }

    /// Leaves the commit lock; before that, chooses `guard` if one is given, and returns the
    /// owner's pending wake.
    ///
    /// # Safety
    ///
    /// This thread has entered it. With a guard, it was open then.
    pub(crate) unsafe fn leave(&self, guard: Option<u32>) -> Option<WakeHandle> {
        // SAFETY: this thread has entered it, so it holds the commit lock, and `enter` is for a
        // select state that needs that lock.
        let wake_handle = guard
            .and_then(|guard| unsafe { self.leave_open_with_lock(guard.saturating_add(CHOSEN)) });
        // SAFETY: the commit lock is this thread's.
        let commit_lock = self.entered.with_mut(|cell| unsafe { (*cell).take() });
        drop(commit_lock);
        wake_handle.flatten()
    }
}
