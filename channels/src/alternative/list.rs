//! The guards of one alternative, as a list with static types.

use super::guard::{Guard, Look, RawGuard};
use crate::select_state::SelectState;
use crate::stamp::Stamp;
use arrayvec::ArrayVec;
use luna_core::current::{PlainPendingWake, Process};
use std::pin::Pin;
use std::ptr::NonNull;

/// Maximum number of guards of one `alt!`. For more use an [`Alternative`](crate::Alternative),
/// which also costs less for many.
pub(super) const MOST_GUARDS: usize = 32;

/// The guards with a true precondition, and their numbers in the order written.
pub(super) type Open<'a> = ArrayVec<(u32, Pin<&'a mut (dyn RawGuard + 'a)>), MOST_GUARDS>;

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

/// The end of the list.
#[derive(Debug)]
pub struct Nil;

/// The end of the list, where `skip` stands.
#[derive(Debug)]
pub struct Skip;

/// A guard, if its precondition holds, and the rest.
#[derive(Debug)]
pub struct Cons<G, R>(pub Option<G>, pub R);

/// A guard that has not been looked at: not where it will stay yet.
pub struct Seed<G: Guard>(G::Seed);

impl<G: Guard> std::fmt::Debug for Seed<G> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Seed")
    }
}

/// Takes a guard; the bound is checked here, at the guard's own expression.
#[inline(always)]
pub fn guard<G: Guard>(guard: G) -> Seed<G> {
    Seed(guard.into_seed())
}

/// A list of guards that have not been looked at.
pub trait Seeds {
    /// The list of the guards.
    type Guards: Guards;

    /// Makes the guards where they are to stay.
    ///
    /// # Safety
    ///
    /// `place` is that of such a list, to be written.
    unsafe fn grow(self, place: *mut Self::Guards);
}

impl Seeds for Nil {
    type Guards = Nil;

    #[inline(always)]
    unsafe fn grow(self, _: *mut Nil) {}
}

impl Seeds for Skip {
    type Guards = Skip;

    #[inline(always)]
    unsafe fn grow(self, _: *mut Skip) {}
}

impl<G: Guard, R: Seeds> Seeds for Cons<Seed<G>, R> {
    type Guards = Cons<G, R::Guards>;

    #[inline(always)]
    unsafe fn grow(self, place: *mut Self::Guards) {
        // Each where it is to stay: a whole that is made and then moved is copied once for each of
        // its parts. SAFETY: the contract.
        unsafe {
            (&raw mut (*place).0).write(self.0.map(|seed| G::from_seed(seed.0)));
            self.1.grow(&raw mut (*place).1);
        }
    }
}

/// A list of guards.
pub trait Guards {
    /// Output of the chosen guard.
    type Output;
    /// How many there are.
    const LEN: usize;
    /// Whether any has something to drop when the alternative is over.
    const DROPS: bool;
    /// Whether `skip` stands at the end.
    const SKIP: bool;

    /// Adds the guards that can happen; the others go when this is called for the `first` time,
    /// before any is listed.
    fn collect<'a>(self: Pin<&'a mut Self>, first: bool, number: u32, into: &mut Collected<'a>);

    /// Looks at the guards that can happen, the first of which has this number; the others go.
    /// `false` if one of them cannot be had that way.
    ///
    /// # Safety
    ///
    /// All guards are new, and this thread is the executor in `looks`.
    unsafe fn look_fast(self: Pin<&mut Self>, number: u32, looks: &mut Looks) -> bool;

    /// Makes guard `chosen` happen, if one is given, and releases the locks of those up to number
    /// `end`; the first has this number. Puts the processes to wake into `ready`.
    ///
    /// # Safety
    ///
    /// The looks up to there have kept the locks, and said that the chosen guard is ready.
    /// `process` has its plain turn.
    unsafe fn leave_home(
        self: Pin<&mut Self>,
        number: u32,
        end: u32,
        chosen: u32,
        process: &Process,
        ready: &mut Option<PlainPendingWake>,
    );

    /// Lists the guards, the first of which has this number, and releases the locks.
    ///
    /// # Safety
    ///
    /// The looks have kept the locks, and said of none that it is ready. `process` has its plain
    /// turn. `selection` outlives the guards' being listed.
    unsafe fn list_fast(
        self: Pin<&mut Self>,
        number: u32,
        process: &Process,
        selection: NonNull<SelectState>,
    );

    /// Takes the guards off their lists that were not chosen, and notes in `looks` what was; the
    /// first has this number.
    ///
    /// # Safety
    ///
    /// The guards were listed, this thread is the executor in `looks`, and `looks` has the number
    /// of the chosen guard.
    unsafe fn withdraw_fast(self: Pin<&mut Self>, number: u32, looks: &mut Looks);

    /// What guard `index` gives, or `skip` if that many it has.
    ///
    /// # Safety
    ///
    /// That guard was chosen and is over, and this is called once.
    unsafe fn output(self: Pin<&mut Self>, index: u32) -> Self::Output;
}

/// Result of the looks at guards on the fast path.
#[derive(Debug)]
pub struct Looks {
    pub(super) home: u64,
    pub(super) is_fair: bool,
    /// The guard to choose; [`NONE`](Looks::NONE) if none can happen.
    pub(super) chosen: u32,
    /// When its end was last chosen.
    stamp: u64,
    /// Where that is noted.
    stamped: Option<NonNull<Stamp>>,
    /// When an end was last chosen.
    greatest: u64,
    /// One more than the number of the last guard with a locked wait point.
    pub(super) end: u32,
    /// Whether the chosen guard is over.
    pub(super) is_over: bool,
}

impl Looks {
    pub(super) const NONE: u32 = u32::MAX;

    #[inline]
    pub(super) fn new(home: u64, is_fair: bool, chosen: u32) -> Self {
        Self {
            home,
            is_fair,
            chosen,
            stamp: u64::MAX,
            stamped: None,
            greatest: 0,
            end: 0,
            is_over: false,
        }
    }

    /// Notes a guard: whether it can happen, and when its end was last chosen. `true` if no other
    /// need be looked at.
    #[inline]
    fn note(&mut self, number: u32, is_ready: bool, end: Option<&Stamp>) -> bool {
        self.end = number + 1;
        if !self.is_fair {
            if is_ready {
                self.chosen = number;
            }
            return is_ready;
        }
        let stamp = end.map_or(0, Stamp::get);
        self.greatest = self.greatest.max(stamp);
        // Of two that were never chosen, the first.
        if is_ready && stamp < self.stamp {
            self.chosen = number;
            self.stamp = stamp;
            self.stamped = end.map(NonNull::from);
        }
        false
    }

    /// Notes a guard that was listed.
    #[inline]
    fn note_listed(&mut self, is_chosen: bool, end: Option<&Stamp>) {
        if self.is_fair {
            self.greatest = self.greatest.max(end.map_or(0, Stamp::get));
            if is_chosen {
                self.stamped = end.map(NonNull::from);
            }
        }
    }

    /// Notes that the chosen guard was chosen.
    ///
    /// # Safety
    ///
    /// The guards are still there.
    #[inline]
    pub(super) unsafe fn stamp(&self) {
        if let Some(stamp) = self.stamped {
            // SAFETY: it lies in an end that the guard borrows.
            unsafe { stamp.as_ref() }.choose(self.greatest);
        }
    }
}

/// What [`Guards::collect`] fills.
#[derive(Default)]
pub struct Collected<'a>(pub(super) Open<'a>);

impl std::fmt::Debug for Collected<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Collected({})", self.0.len())
    }
}

impl Guards for Nil {
    type Output = Never;
    const LEN: usize = 0;
    const DROPS: bool = false;
    const SKIP: bool = false;

    fn collect<'a>(self: Pin<&'a mut Self>, _: bool, _: u32, _: &mut Collected<'a>) {}

    #[inline]
    unsafe fn look_fast(self: Pin<&mut Self>, _: u32, _: &mut Looks) -> bool {
        true
    }

    #[inline]
    unsafe fn leave_home(
        self: Pin<&mut Self>,
        _: u32,
        _: u32,
        _: u32,
        _: &Process,
        _: &mut Option<PlainPendingWake>,
    ) {
    }

    #[inline]
    unsafe fn list_fast(self: Pin<&mut Self>, _: u32, _: &Process, _: NonNull<SelectState>) {}

    #[inline]
    unsafe fn withdraw_fast(self: Pin<&mut Self>, _: u32, _: &mut Looks) {}

    unsafe fn output(self: Pin<&mut Self>, _: u32) -> Never {
        unreachable!("an alternative has chosen a guard that it does not have")
    }
}

impl Guards for Skip {
    type Output = ();
    const LEN: usize = 0;
    const DROPS: bool = false;
    const SKIP: bool = true;

    fn collect<'a>(self: Pin<&'a mut Self>, _: bool, _: u32, _: &mut Collected<'a>) {}

    #[inline]
    unsafe fn look_fast(self: Pin<&mut Self>, _: u32, _: &mut Looks) -> bool {
        true
    }

    #[inline]
    unsafe fn leave_home(
        self: Pin<&mut Self>,
        _: u32,
        _: u32,
        _: u32,
        _: &Process,
        _: &mut Option<PlainPendingWake>,
    ) {
    }

    #[inline]
    unsafe fn list_fast(self: Pin<&mut Self>, _: u32, _: &Process, _: NonNull<SelectState>) {}

    #[inline]
    unsafe fn withdraw_fast(self: Pin<&mut Self>, _: u32, _: &mut Looks) {}

    unsafe fn output(self: Pin<&mut Self>, _: u32) {}
}

impl<G, R> Cons<G, R> {
    #[inline]
    fn parts(self: Pin<&mut Self>) -> (Pin<&mut Option<G>>, Pin<&mut R>) {
        // SAFETY: both fields are pinned with the whole.
        unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.0),
                Pin::new_unchecked(&mut this.1),
            )
        }
    }
}

impl<G: Guard, R: Guards> Guards for Cons<G, R> {
    type Output = Either<G::Output, R::Output>;
    const LEN: usize = R::LEN + 1;
    const DROPS: bool = G::DROPS || R::DROPS;
    const SKIP: bool = R::SKIP;

    #[inline]
    fn collect<'a>(self: Pin<&'a mut Self>, first: bool, number: u32, into: &mut Collected<'a>) {
        let (mut guard, rest) = self.parts();
        if first
            && guard
                .as_ref()
                .as_pin_ref()
                .is_some_and(|guard| !guard.is_open())
        {
            guard.set(None);
        }
        if let Some(guard) = guard.as_pin_mut() {
            into.0.push((number, guard));
        }
        rest.collect(first, number + 1, into);
    }

    #[inline]
    unsafe fn look_fast(self: Pin<&mut Self>, number: u32, looks: &mut Looks) -> bool {
        let (mut first, rest) = self.parts();
        if let Some(mut guard) = first.as_mut().as_pin_mut() {
            if guard.is_open() {
                // SAFETY: the contract.
                let look = unsafe { guard.as_mut().look_fast(looks.home) };
                if look == Look::No {
                    return false;
                }
                if looks.note(number, look == Look::Ready, guard.stamp()) {
                    return true;
                }
            } else {
                first.set(None);
            }
        }
        // SAFETY: the contract.
        unsafe { rest.look_fast(number + 1, looks) }
    }

    #[inline]
    unsafe fn leave_home(
        self: Pin<&mut Self>,
        number: u32,
        end: u32,
        chosen: u32,
        process: &Process,
        ready: &mut Option<PlainPendingWake>,
    ) {
        if number == end {
            return;
        }
        let (first, rest) = self.parts();
        // SAFETY: the contract.
        unsafe {
            if let Some(first) = first.as_pin_mut() {
                if number == chosen {
                    *ready = first.take_fast(process);
                } else {
                    first.leave_home(process.home_number());
                }
            }
            rest.leave_home(number + 1, end, chosen, process, ready);
        }
    }

    #[inline]
    unsafe fn list_fast(
        self: Pin<&mut Self>,
        number: u32,
        process: &Process,
        selection: NonNull<SelectState>,
    ) {
        let (first, rest) = self.parts();
        // SAFETY: the contract.
        unsafe {
            if let Some(first) = first.as_pin_mut() {
                first.list_fast(process, selection, number);
            }
            rest.list_fast(number + 1, process, selection);
        }
    }

    #[inline]
    unsafe fn withdraw_fast(self: Pin<&mut Self>, number: u32, looks: &mut Looks) {
        let (first, rest) = self.parts();
        // SAFETY: the contract.
        unsafe {
            if let Some(mut first) = first.as_pin_mut() {
                let is_chosen = number == looks.chosen;
                if is_chosen {
                    looks.is_over = first.is_over();
                } else {
                    first.as_mut().withdraw_fast(looks.home);
                }
                looks.note_listed(is_chosen, first.stamp());
            }
            rest.withdraw_fast(number + 1, looks);
        }
    }

    #[inline]
    unsafe fn output(self: Pin<&mut Self>, index: u32) -> Self::Output {
        let (first, rest) = self.parts();
        match (index.checked_sub(1), first.as_pin_mut()) {
            // SAFETY: the contract.
            (None, Some(first)) => Either::L(unsafe { first.output() }),
            (None, None) => unreachable!("an alternative has chosen a guard that is not open"),
            // SAFETY: the contract.
            (Some(index), _) => Either::R(unsafe { rest.output(index) }),
        }
    }
}
