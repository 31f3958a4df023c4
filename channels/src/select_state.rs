//! One choice among several offers, made by one compare-and-swap, or under a lock.
//!
//! An alternative lists a node in each of its channels, and all of them lead to one *selection*. Whoever comes to one of these channels
//! as a partner, under the channel's lock, claims the selection: of all who try, one succeeds, and goes on as with any waiting
//! operation. The others find the choice made, take the stale node off their list, and look at who waits behind it.
//!
//! ```text
//!   CLOSED --owner lists its nodes--> OPEN --partner or owner, by compare-and-swap--> CHOSEN(guard)
//! ```
//!
//! Where the exchange alone does not do, all who leave `OPEN` hold the selection's *gate*, and say so by a plain store. That is so if somebody
//! may claim several selections at once, or close this one for its owner; and where all is at home: the gate is a lock that favours a home, so who
//! claims there executes no read-modify-write. Which of both it is stays the same from an opening until the selection is left.
//!
//! Nobody waits for another to leave an intermediate state: a claim that fails is final for that node, and the owner that finds its
//! selection chosen takes the lock of the one channel to learn the outcome.

use luna_core::biased_lock::{BiasedGuard, BiasedLock, InsideGuard};
use luna_core::current::{PlainPendingWake, Process, WakeHandle};
use luna_platform::clock::{Clock, Instant};
use luna_platform::sync::UnsafeCell;
use luna_platform::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, AtomicUsize, Ordering};
use std::ptr::NonNull;

/// Nobody can claim it: the owner does not wait.
const CLOSED: u32 = 0;
/// The first who claims it has it.
const OPEN: u32 = 1;
/// Guard `state - CHOSEN` was chosen.
const CHOSEN: u32 = 2;

/// The choice of one alternative.
///
/// # Invariants
///
/// `wakeup` belongs to the owner unless the state is `OPEN`; from `OPEN`, to whoever left it. Where that was no choice but a
/// closing by somebody else ([`close`](SelectState::close)), the owner learns of it before the other has taken the wakeup: such selections are
/// `gated`, and the gate is held around both. `has_plain_wakeup` goes with it. `gated` is changed by the owner alone, while no node leads here that is listed. `entered` belongs to who holds the gate. While a node that leads here is listed, this is live: its owner takes each node off, under its list's lock, before it goes.
#[derive(Debug)]
pub struct SelectState {
    state: AtomicU32,
    /// Whether who leaves `OPEN` holds the gate: somebody may claim several selections at once, a barrier's last party, or close this one for its
    /// owner; or all places favour one home.
    gated: AtomicBool,
    /// Whether the wakeup is one of a plain turn at the home that the gate favours.
    has_plain_wakeup: AtomicBool,
    /// From when on the guards from `first_late` on cannot be claimed any more, as nanoseconds: a delay that comes before them has passed then,
    /// and is what the owner chooses, though it may not have run yet.
    late_from: AtomicU64,
    first_late: AtomicU32,
    /// Whose clock that is: a partner by another one cannot tell.
    clock: AtomicUsize,
    wakeup: UnsafeCell<Option<WakeHandle>>,
    /// Held around each claim where `gated` is set, so that who claims several sees all of them open at one instant.
    gate: BiasedLock<()>,
    entered: UnsafeCell<Option<BiasedGuard<'static, ()>>>,
    /// A model is replayed, and addresses are not the same again.
    #[cfg(loom)]
    number: usize,
}

impl SelectState {
    pub(crate) fn new() -> Self {
        Self {
            state: AtomicU32::new(CLOSED),
            gated: AtomicBool::new(false),
            has_plain_wakeup: AtomicBool::new(false),
            late_from: AtomicU64::new(u64::MAX),
            first_late: AtomicU32::new(0),
            clock: AtomicUsize::new(0),
            wakeup: UnsafeCell::new(None),
            gate: BiasedLock::new(()),
            entered: UnsafeCell::new(None),
            #[cfg(loom)]
            number: {
                static NEXT: std::sync::atomic::AtomicUsize =
                    std::sync::atomic::AtomicUsize::new(0);
                NEXT.fetch_add(1, std::sync::atomic::Ordering::Relaxed)
            },
        }
    }

    /// Lets others claim it from now on; `wakeup` is whom they then ready. With a `limit`, the guards from its number on can be claimed until its
    /// instant only.
    ///
    /// # Safety
    ///
    /// The owner calls this, and the selection is closed.
    pub(crate) unsafe fn open(
        &self,
        wakeup: WakeHandle,
        several: bool,
        limit: Option<(Instant, u32)>,
    ) {
        self.gated.store(several, Ordering::Relaxed);
        self.has_plain_wakeup.store(false, Ordering::Relaxed);
        if let Some((instant, first_late)) = limit {
            self.first_late.store(first_late, Ordering::Relaxed);
            self.clock.store(Clock::number_here(), Ordering::Relaxed);
            self.late_from.store(instant.as_nanos(), Ordering::Relaxed);
        }
        // SAFETY: of a closed selection it is the owner's; nobody closes this one for the owner before it was opened.
        self.wakeup.with_mut(|cell| unsafe { *cell = Some(wakeup) });
        self.state.store(OPEN, Ordering::Release);
    }

    /// As [`open`](Self::open), for the process whose plain turn this is, where all places favour its home: so does the gate from now on.
    ///
    /// # Safety
    ///
    /// As for `open`; and the selection was never opened, nobody else knows it, this thread is the home of `process`, and a place's lock favours it.
    #[inline]
    pub(crate) unsafe fn open_fast(&self, process: &Process) {
        // SAFETY: the contract.
        unsafe { self.gate.favour_from_the_start(process.home_number()) };
        self.gated.store(true, Ordering::Relaxed);
        // SAFETY: the gate favours the home, and nobody else knows it.
        unsafe { self.open_plainly(process) };
    }

    /// Makes claims need the gate, for good: for a selection that others may close.
    pub(crate) fn set_gated(&mut self) {
        self.gated.store(true, Ordering::Relaxed);
    }

    /// Enters the gate for one step. What it guards beside the state is its owner's affair.
    #[inline]
    pub(crate) fn gate(&self) -> BiasedGuard<'_, ()> {
        self.gate.lock()
    }

    /// As [`gate`](Self::gate), if it favours this home.
    ///
    /// # Safety
    ///
    /// This thread is the home of that number.
    #[inline(always)]
    pub(crate) unsafe fn gate_if_favoured(&self, home: u64) -> Option<InsideGuard<'_, ()>> {
        // SAFETY: the contract.
        unsafe { self.gate.lock_if_favoured(home) }
    }

    /// Opens a selection that is gated for good.
    ///
    /// # Safety
    ///
    /// The owner calls this, the selection is closed, and the gate is held.
    pub(crate) unsafe fn open_gated(&self, wakeup: WakeHandle) {
        self.has_plain_wakeup.store(false, Ordering::Relaxed);
        // SAFETY: of a closed selection it is the owner's; who has closed it for the owner has left the gate.
        self.wakeup.with_mut(|cell| unsafe { *cell = Some(wakeup) });
        self.state.store(OPEN, Ordering::Release);
    }

    /// As [`open_gated`](Self::open_gated), for the process whose plain turn this is.
    ///
    /// # Safety
    ///
    /// As there; the gate favours the home of `process`, which is this thread; and `process` was
    /// given by `current::plain_turn` or `current::unrecorded_turn` in this turn.
    #[inline]
    pub(crate) unsafe fn open_plainly(&self, process: &Process) {
        self.has_plain_wakeup.store(true, Ordering::Relaxed);
        // SAFETY: by the contract it is the current process, in a plain turn.
        let wakeup = Some(unsafe { WakeHandle::of_plain_turn(process) });
        // SAFETY: as for `open_gated`. A wakeup that is left there is that of an opening which nobody has left: there is none.
        self.wakeup.with_mut(|cell| unsafe { *cell = wakeup });
        self.state.store(OPEN, Ordering::Release);
    }

    /// Chooses `guard`, if the selection is open with a [plain](Self::open_plainly) wakeup: gives what readies the owner.
    ///
    /// # Safety
    ///
    /// The gate is held by the home that it favours. This is a partner, as for [`claim`](Self::claim).
    #[inline(always)]
    pub(crate) unsafe fn claim_plainly(&self, guard: u32) -> Option<PlainPendingWake> {
        if !self.is_open() || !self.has_plain_wakeup.load(Ordering::Relaxed) || self.is_late(guard)
        {
            return None;
        }
        // SAFETY: the gate is held, and the state is `OPEN` and about to be left. The wakeup was made on this thread.
        let ready = self
            .wakeup
            .with_mut(|cell| unsafe { WakeHandle::take_plain(&mut *cell) })?;
        self.state
            .store(guard.saturating_add(CHOSEN), Ordering::Release);
        Some(ready)
    }

    /// Readies another one when it is claimed. Gives the former.
    ///
    /// # Safety
    ///
    /// The owner calls this, and nobody can claim the selection meanwhile: it is closed, or the owner holds the locks of all lists that its
    /// nodes are in.
    pub(crate) unsafe fn replace_wakeup(&self, wakeup: WakeHandle) -> Option<WakeHandle> {
        self.has_plain_wakeup.store(false, Ordering::Relaxed);
        // SAFETY: the contract leaves the owner alone with it.
        self.wakeup
            .with_mut(|cell| unsafe { (*cell).replace(wakeup) })
    }

    /// Which guard was chosen, if one was. Acquire: what came before the claim is visible.
    #[inline]
    pub(crate) fn chosen(&self) -> Option<u32> {
        self.state.load(Ordering::Acquire).checked_sub(CHOSEN)
    }

    /// Whether nothing is chosen and its owner waits.
    #[inline]
    pub(crate) fn is_open(&self) -> bool {
        self.state.load(Ordering::Acquire) == OPEN
    }

    /// Chooses `guard`, if nothing is chosen yet: gives what readies the owner.
    ///
    /// For partners, under the lock of the list in which they found a node that leads here.
    #[inline]
    pub(crate) fn claim(&self, guard: u32) -> Option<Option<WakeHandle>> {
        if self.state.load(Ordering::Acquire) != OPEN || self.is_late(guard) {
            return None;
        }
        self.leave_open(guard.saturating_add(CHOSEN))
    }

    /// As [`claim`](Self::claim), by the owner for a guard of its own whose time has come. It need not be readied.
    #[must_use = "the handle's drop is user code, and the owner's last step"]
    pub(crate) fn claim_own(&self, guard: u32) -> Option<WakeHandle> {
        self.leave_open(guard.saturating_add(CHOSEN)).flatten()
    }

    /// Whether a delay that comes before `guard` has passed.
    #[inline]
    fn is_late(&self, guard: u32) -> bool {
        let late_from = self.late_from.load(Ordering::Relaxed);
        late_from != u64::MAX
            && guard >= self.first_late.load(Ordering::Relaxed)
            && self.clock.load(Ordering::Relaxed) == Clock::number_here()
            && Instant::now().as_nanos() >= late_from
    }

    /// Takes the choice back from everybody, if nothing is chosen yet: gives what would have readied the owner.
    #[must_use = "the handle's drop is user code, and the owner's last step"]
    pub(crate) fn close(&self) -> Option<Option<WakeHandle>> {
        self.leave_open(CLOSED)
    }

    /// Leaves `OPEN` for `state`, if that is the state: gives the wakeup, if one is there.
    #[inline]
    fn leave_open(&self, state: u32) -> Option<Option<WakeHandle>> {
        if self.gated.load(Ordering::Relaxed) {
            let _gate = self.gate.lock();
            // SAFETY: the gate is held.
            return unsafe { self.leave_open_gated(state) };
        }
        self.state
            .compare_exchange(OPEN, state, Ordering::AcqRel, Ordering::Relaxed)
            .ok()?;
        // SAFETY: this thread's exchange left `OPEN`, so the wakeup is its own.
        Some(self.wakeup.with_mut(|cell| unsafe { (*cell).take() }))
    }

    /// As [`leave_open`](Self::leave_open), within the gate.
    ///
    /// # Safety
    ///
    /// The selection is gated, and the gate is held.
    #[inline]
    unsafe fn leave_open_gated(&self, state: u32) -> Option<Option<WakeHandle>> {
        if self.state.load(Ordering::Acquire) != OPEN {
            return None;
        }
        // SAFETY: nobody else leaves `OPEN` while the gate is held, so the wakeup is this thread's.
        let wakeup = self.wakeup.with_mut(|cell| unsafe { (*cell).take() });
        // After it was taken: who sees the selection left, the owner, may open it again.
        self.state.store(state, Ordering::Release);
        Some(wakeup)
    }

    /// The order in which several gates are entered: that of the addresses.
    ///
    /// # Safety
    ///
    /// `this` is live.
    pub(crate) unsafe fn order(this: NonNull<SelectState>) -> usize {
        #[cfg(loom)]
        // SAFETY: the contract.
        return unsafe { this.as_ref() }.number;
        #[cfg(not(loom))]
        this.addr().get()
    }

    /// Enters the gate: until [`leave`](Self::leave), nobody else claims. Says whether `guard` can be chosen.
    ///
    /// Who enters several gates does so in their [`order`](Self::order).
    ///
    /// # Safety
    ///
    /// `this` is gated, is live until `leave`, and this thread has not entered it.
    pub(crate) unsafe fn enter(this: NonNull<SelectState>, guard: u32) -> bool {
        // SAFETY: the contract keeps it alive for as long as the guard is kept.
        let selection: &'static SelectState = unsafe { this.as_ref() };
        let gate = selection.gate.lock();
        // SAFETY: the gate is this thread's.
        selection
            .entered
            .with_mut(|cell| unsafe { *cell = Some(gate) });
        selection.state.load(Ordering::Acquire) == OPEN && !selection.is_late(guard)
    }

    /// Leaves the gate; before that, chooses `guard` if one is given, and gives what readies the owner.
    ///
    /// # Safety
    ///
    /// This thread has entered it. With a guard, it was open then.
    pub(crate) unsafe fn leave(&self, guard: Option<u32>) -> Option<WakeHandle> {
        // SAFETY: the contract.
        let wakeup =
            guard.and_then(|guard| unsafe { self.leave_open_gated(guard.saturating_add(CHOSEN)) });
        // SAFETY: the gate is this thread's.
        let gate = self.entered.with_mut(|cell| unsafe { (*cell).take() });
        drop(gate);
        wakeup.flatten()
    }
}
