//! The guards of one alternative: how `alt!` takes them, where they stay, and what they offer.

use super::after::After;
use super::guard::{Guard, RawGuard, Terms};
use super::when::{Due, When};
use crate::barrier::SyncOp;
use crate::operation::{Direction, Operation};
use crate::stamp::Stamp;
use crate::wait_point::{WaitPoint, Waiting};
use crate::waiter::{Outcome, Waiter};
use core::marker::PhantomPinned;
use core::mem::MaybeUninit;
use core::pin::Pin;
use core::ptr::NonNull;
use luna_core::current::Here;

/// Output of the first guard, or of one of the rest.
#[derive(Debug)]
pub enum Either<L, R> {
    /// The first.
    L(L),
    /// One of the rest.
    R(R),
}

/// The output of no guard.
#[derive(Debug)]
pub enum Never {}

/// The output of a guard that is not there.
///
/// # Panics
///
/// Always: it cannot be chosen.
#[cold]
pub fn no_guard(number: u32) -> Never {
    unreachable!(
        "an alternative has chosen a guard that it does not have: {number} behind the last"
    )
}

/// What may stand as a guard, which an alternative takes as `Taken`. Each kind of guard has one
/// implementation of its own, from which the compiler infers `Taken`. For any other type it cannot
/// infer that, and reports this one error.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a guard of an alternative",
    label = "write the operation without `.await`: `recv()`, `send(..)`, `sync()`, `luna::after(..)`",
    note = "the alternative itself awaits its guards: `v = s.recv() => ..`",
    note = "a guard is not any future: put other work in the body, or in a process of its own that answers over a channel"
)]
pub trait Offered<Taken> {
    /// Takes it.
    fn into_seed_of(self) -> Taken;
}

macro_rules! offered {
    ($([$($parameter:tt)*] $guard:ty;)*) => {$(
        #[diagnostic::do_not_recommend]
        impl<$($parameter)*> Offered<Seed<Self>> for $guard {
            #[inline(always)]
            fn into_seed_of(self) -> Seed<Self> {
                Seed(self.into_seed())
            }
        }
    )*};
}

offered! {
    [] After;
    ['a] SyncOp<'a>;
    [D: Due] When<D>;
    ['a, T, D: Direction<T>] Operation<'a, T, D>;
}

/// A guard that has not been looked at: not where it will stay yet.
pub struct Seed<G: Guard>(G::Seed);

impl<G: Guard> core::fmt::Debug for Seed<G> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Seed")
    }
}

/// Takes a guard; the bound is checked here, at the guard's own expression.
#[inline(always)]
pub fn guard<G: Offered<Taken>, Taken>(guard: G) -> Taken {
    guard.into_seed_of()
}

/// Where a guard stays while its alternative is under way.
///
/// # Invariants
///
/// The guard is there if `is_there`; from then on this is pinned.
#[derive(Debug)]
pub struct Place<G: Guard> {
    guard: MaybeUninit<G>,
    is_there: bool,
    _pinned: PhantomPinned,
}

impl<G: Guard> Place<G> {
    /// Without a guard: one with a false precondition.
    #[inline(always)]
    pub const fn empty() -> Self {
        Self {
            guard: MaybeUninit::uninit(),
            is_there: false,
            _pinned: PhantomPinned,
        }
    }

    /// Makes the guard here, where it is to stay, if it is open.
    #[inline(always)]
    pub fn plant(self: Pin<&mut Self>, seed: Option<Seed<G>>) {
        // SAFETY: nothing is moved out of the place.
        let this = unsafe { self.get_unchecked_mut() };
        if let Some(seed) = seed {
            let guard = this.guard.write(G::from_seed(seed.0));
            this.is_there = guard.is_open();
            if !this.is_there {
                // SAFETY: it was just written, and is not used again.
                unsafe { this.guard.assume_init_drop() };
            }
        }
    }

    /// The guard, for the alternative.
    #[inline(always)]
    pub fn offer(self: Pin<&mut Self>) -> Offer<'_> {
        // SAFETY: nothing is moved out of the place.
        let this = unsafe { self.get_unchecked_mut() };
        if !this.is_there {
            return Offer::default();
        }
        // SAFETY: it is there, and pinned with the whole.
        let guard = unsafe { Pin::new_unchecked(this.guard.assume_init_mut()) };
        let terms = guard.terms();
        Offer {
            guard: Some(guard),
            terms,
        }
    }

    /// The alternative is over, and no node of this guard is listed.
    #[inline(always)]
    pub fn decided(self: Pin<&mut Self>) {
        if !G::DROPS {
            // SAFETY: nothing is moved. What is not dropped has nothing to drop.
            unsafe { self.get_unchecked_mut() }.is_there = false;
        }
    }

    /// The output of the guard.
    ///
    /// # Safety
    ///
    /// Its alternative has chosen it, and this is called once.
    #[inline(always)]
    pub unsafe fn output(self: Pin<&mut Self>) -> G::Output {
        // SAFETY: a guard that was chosen was there. It is pinned with the whole, and is over: an
        // alternative has chosen it, and this is called once, as is demanded here.
        unsafe { Pin::new_unchecked(self.get_unchecked_mut().guard.assume_init_mut()).output() }
    }
}

impl<G: Guard> Drop for Place<G> {
    #[inline(always)]
    fn drop(&mut self) {
        if self.is_there {
            // SAFETY: by the invariant it is there.
            unsafe { self.guard.assume_init_drop() };
        }
    }
}

/// What a guard offers to its alternative; nothing if it is closed.
///
/// # Invariants
///
/// The terms are those of the guard.
#[derive(Default)]
pub struct Offer<'a> {
    guard: Option<Pin<&'a mut (dyn RawGuard + 'a)>>,
    terms: Terms,
}

/// What a plain guard offers.
pub(super) struct PlainOffer<'a> {
    pub(super) wait_point: &'a WaitPoint,
    pub(super) stamp: &'a Stamp,
    pub(super) waiter: NonNull<Waiter<()>>,
    pub(super) of_sender: bool,
}

impl core::fmt::Debug for Offer<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_tuple("Offer").field(&self.terms).finish()
    }
}

// SAFETY: it is made by `alt!` alone, where the place that it borrows lies in the same future: that
// can be sent and shared only if the guard can.
unsafe impl Send for Offer<'_> {}
// SAFETY: see above.
unsafe impl Sync for Offer<'_> {}

impl<'a> Offer<'a> {
    #[inline(always)]
    pub(super) fn is_open(&self) -> bool {
        self.guard.is_some()
    }

    #[inline(always)]
    pub(super) fn guard(&self) -> Option<&(dyn RawGuard + 'a)> {
        self.guard.as_deref()
    }

    #[inline(always)]
    pub(super) fn guard_mut(&mut self) -> Option<Pin<&mut (dyn RawGuard + 'a)>> {
        self.guard.as_mut().map(Pin::as_mut)
    }

    /// Not to be considered any more: it is listed nowhere.
    pub(super) fn close(&mut self) {
        *self = Self::default();
    }

    #[inline(always)]
    pub(super) fn wait_point(&self) -> Option<&'a WaitPoint> {
        // SAFETY: the wait point of a guard's terms outlives the guard, which is borrowed for `'a`.
        self.terms
            .wait_point
            .map(|wait_point| unsafe { wait_point.as_ref() })
    }

    /// Whether it depends on the clock alone.
    pub(super) fn is_of_time(&self) -> bool {
        self.is_open() && self.terms.wait_point.is_none()
    }

    /// The waiter of a plain guard.
    #[inline(always)]
    pub(super) fn plain(&self) -> Option<NonNull<Waiter<()>>> {
        self.terms.plain.map(NonNull::cast)
    }

    #[inline(always)]
    pub(super) fn of_sender(&self) -> bool {
        self.terms.of_sender
    }

    /// What it offers, which is plain.
    ///
    /// # Safety
    ///
    /// It is.
    #[inline(always)]
    pub(super) unsafe fn plain_offer(&self) -> PlainOffer<'a> {
        debug_assert!(self.plain().is_some());
        // SAFETY: it is plain, as is demanded here. So it has a wait point and a stamp, by the
        // promise of `RawGuard`, and they outlive the guard, which is borrowed for `'a`.
        unsafe {
            PlainOffer {
                wait_point: self.terms.wait_point.unwrap_unchecked().as_ref(),
                stamp: self.terms.stamp.unwrap_unchecked().as_ref(),
                waiter: self.terms.plain.unwrap_unchecked().cast(),
                of_sender: self.terms.of_sender,
            }
        }
    }

    pub(super) fn can_fail(&self) -> bool {
        self.terms.can_fail
    }

    /// When its end was last chosen. A guard without memory (a delay that has passed) counts as
    /// never chosen.
    #[inline(always)]
    pub(super) fn stamp(&self) -> u64 {
        match self.terms.stamp {
            // SAFETY: the stamp of a guard's terms outlives the guard.
            Some(stamp) => unsafe { stamp.as_ref() }.get(),
            None => self.stamp_of_time(),
        }
    }

    #[cold]
    #[inline(never)]
    fn stamp_of_time(&self) -> u64 {
        let stamp = self.guard().and_then(|guard| guard.stamp());
        stamp.map_or(0, |stamp| stamp.get())
    }

    /// Notes that it was chosen, among ends of which the greatest stamp is `greatest`.
    #[inline(always)]
    pub(super) fn choose(&self, greatest: u64) {
        let stamp = match self.terms.stamp {
            // SAFETY: as in `stamp`.
            Some(stamp) => Some(unsafe { stamp.as_ref() }),
            None => self.guard().and_then(|guard| guard.stamp()),
        };
        if let Some(stamp) = stamp {
            stamp.choose(greatest);
        }
    }

    /// Takes it off its list, if it is still there: another one was chosen, or none. It was listed.
    #[inline(always)]
    pub(super) fn withdraw(&mut self, here: Here<'_>) {
        let Some(wait_point) = self.wait_point() else {
            return;
        };
        if let Some(waiter) = self.plain() {
            let of_sender = self.of_sender();
            // SAFETY: it was listed, so its node was begun.
            if unsafe { withdraw_alone(wait_point, waiter, of_sender, here) } {
                return;
            }
        }
        self.withdraw_listed();
    }

    /// As [`withdraw`](Self::withdraw), wherever it waits.
    #[inline(never)]
    pub(super) fn withdraw_listed(&mut self) {
        if let Some(mut guard) = self.guard_mut() {
            guard.as_mut().note_begun();
            // SAFETY: this is the guard's alternative.
            unsafe { guard.withdraw() };
        }
    }
}

impl PlainOffer<'_> {
    /// Withdraws it, if that needs no step of the guard's own.
    ///
    /// # Safety
    ///
    /// It was listed.
    #[inline(always)]
    pub(super) unsafe fn withdraw(&self, here: Here<'_>) -> bool {
        // SAFETY: as is demanded here.
        unsafe { withdraw_alone(self.wait_point, self.waiter, self.of_sender, here) }
    }
}

/// Takes the node of a plain guard off that waits alone. `false`: it waits in another way.
///
/// # Safety
///
/// It is that of a plain guard at `wait_point`, and was begun.
#[inline(always)]
unsafe fn withdraw_alone(
    wait_point: &WaitPoint,
    waiter: NonNull<Waiter<()>>,
    of_sender: bool,
    here: Here<'_>,
) -> bool {
    // SAFETY: the node was begun. Under the lock of its wait point one that is noted there as alone
    // waits, and is noted there no more when it is settled.
    unsafe {
        if !Waiter::is_waiting(waiter) {
            return true;
        }
        let Some(mut lists) = wait_point.enter_in(here) else {
            return false;
        };
        let is_alone = lists.waiting == Waiting::alone_guard(waiter.cast(), of_sender);
        if is_alone {
            lists.set_nothing_waits();
            Waiter::set_outcome(waiter, Outcome::Stale);
        }
        is_alone
    }
}
