//! The guards of one alternative, as a list with static types.

use super::after::After;
use super::fast_path::{Finish, Visit};
use super::guard::{Guard, RawGuard};
use super::when::{Due, When};
use crate::barrier::SyncOp;
use crate::operation::{Direction, Operation};
use arrayvec::ArrayVec;
use core::mem::MaybeUninit;
use core::pin::Pin;

/// Maximum number of guards of one `alt!`. For more use an [`Alternative`](crate::Alternative),
/// which also costs less for many.
pub(super) const MAX_GUARDS: usize = 32;

/// The open guards, and their numbers in the order written.
pub(super) type Open<'a> = ArrayVec<(u32, Pin<&'a mut (dyn RawGuard + 'a)>), MAX_GUARDS>;

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

/// A guard, in an `Option` if it has a precondition, and the rest.
#[derive(Debug)]
pub struct Cons<G, R>(pub G, pub R);

/// A guard without a precondition.
#[derive(Debug)]
pub struct Sure<G> {
    guard: G,
    /// Whether it can happen at all, if not all such guards can.
    is_open: MaybeUninit<bool>,
}

/// What may stand as a guard, which a list takes as `Listed`. Each kind of guard has one
/// implementation of its own, from which the compiler infers `Listed`. For any other type it cannot
/// infer that, and reports this one error.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a guard of an alternative",
    label = "write the operation without `.await`: `recv()`, `send(..)`, `sync()`, `luna::after(..)`",
    note = "the alternative itself awaits its guards: `v = s.recv() => ..`",
    note = "a guard is not any future: put other work in the body, or in a process of its own that answers over a channel"
)]
pub trait Offered<Listed> {
    /// Takes it.
    fn into_list(self) -> Listed;
}

macro_rules! offered {
    ($([$($parameter:tt)*] $guard:ty;)*) => {$(
        #[diagnostic::do_not_recommend]
        impl<$($parameter)*> Offered<Seed<Self>> for $guard {
            #[inline(always)]
            fn into_list(self) -> Seed<Self> {
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
pub fn guard<G: Offered<Listed>, Listed>(guard: G) -> Listed {
    guard.into_list()
}

/// A guard that has not been looked at, if its precondition holds.
pub trait Planted {
    /// Where it is to stay.
    type Place: Place;

    /// Makes the guard there.
    ///
    /// # Safety
    ///
    /// `place` is to be written.
    unsafe fn plant(self, place: *mut Self::Place);
}

impl<G: Guard> Planted for Seed<G> {
    type Place = Sure<G>;

    #[inline(always)]
    unsafe fn plant(self, place: *mut Sure<G>) {
        // SAFETY: `place` is to be written, as is demanded here: its fields are written before they
        // are read.
        unsafe {
            (&raw mut (*place).guard).write(G::from_seed(self.0));
            if !G::ALWAYS_OPEN {
                (*place).is_open.write((*place).guard.is_open());
            }
        }
    }
}

impl<G: Guard> Planted for Option<Seed<G>> {
    type Place = Option<G>;

    #[inline(always)]
    unsafe fn plant(self, place: *mut Option<G>) {
        // SAFETY: `place` is to be written, as is demanded here. It is written before it is read
        // and replaced.
        unsafe {
            place.write(self.map(|seed| G::from_seed(seed.0)));
            if (*place).as_ref().is_some_and(|guard| !guard.is_open()) {
                *place = None;
            }
        }
    }
}

/// Where a guard stays.
pub trait Place {
    /// What stays there.
    type Guard: Guard;

    /// The guard, if it is open.
    fn open(self: Pin<&mut Self>) -> Option<Pin<&mut Self::Guard>>;
}

impl<G: Guard> Place for Sure<G> {
    type Guard = G;

    #[inline(always)]
    fn open(self: Pin<&mut Self>) -> Option<Pin<&mut G>> {
        // SAFETY: the guard is pinned with the whole.
        let this = unsafe { self.get_unchecked_mut() };
        // SAFETY: the guard is pinned with the whole. `is_open` was written by `plant`, the only
        // way to make this, unless all such guards are open.
        unsafe {
            (G::ALWAYS_OPEN || this.is_open.assume_init())
                .then(|| Pin::new_unchecked(&mut this.guard))
        }
    }
}

impl<G: Guard> Place for Option<G> {
    type Guard = G;

    #[inline(always)]
    fn open(self: Pin<&mut Self>) -> Option<Pin<&mut G>> {
        self.as_pin_mut()
    }
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

impl<G: Planted, R: Seeds> Seeds for Cons<G, R> {
    type Guards = Cons<G::Place, R::Guards>;

    #[inline(always)]
    unsafe fn grow(self, place: *mut Self::Guards) {
        // Each where it is to stay: a whole that is made and then moved is copied once for each of
        // its parts. SAFETY: the list at `place` is to be written, as is demanded here, and so is
        // each of its fields.
        unsafe {
            self.0.plant(&raw mut (*place).0);
            self.1.grow(&raw mut (*place).1);
        }
    }
}

/// A list of guards, in the order written. `number` is that of the first.
pub trait Guards {
    /// Output of the chosen guard.
    type Output;
    /// How many there are.
    const LEN: usize;
    /// Whether any has something to drop when the alternative is over.
    const DROPS: bool;
    /// Whether `skip` stands at the end.
    const SKIP: bool;
    /// Whether all of them can take the fast path.
    const PLAIN: bool;

    /// Adds the open guards.
    fn collect<'a>(self: Pin<&'a mut Self>, number: u32, into: &mut Collected<'a>);

    /// Goes to the open guards, until the visitor stops it. Only for a [plain](Self::PLAIN) list.
    fn each(self: Pin<&mut Self>, number: u32, step: &mut impl Visit);

    /// The output of guard `index`, if `step` gives it, or of `skip` if that is their number.
    ///
    /// # Safety
    ///
    /// The guard is as `step` demands.
    unsafe fn finish(self: Pin<&mut Self>, index: u32, step: impl Finish) -> Option<Self::Output>;
}

/// What [`Guards::collect`] fills.
#[derive(Default)]
pub struct Collected<'a>(pub(super) Open<'a>);

impl core::fmt::Debug for Collected<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "Collected({})", self.0.len())
    }
}

/// The end of a list, with or without `skip`.
macro_rules! end_of_list {
    ($end:ty, $output:ty, $skip:expr, $result:expr) => {
        impl Guards for $end {
            type Output = $output;
            const LEN: usize = 0;
            const DROPS: bool = false;
            const SKIP: bool = $skip;
            const PLAIN: bool = true;

            #[inline(always)]
            fn collect<'a>(self: Pin<&'a mut Self>, _: u32, _: &mut Collected<'a>) {}

            #[inline(always)]
            fn each(self: Pin<&mut Self>, _: u32, _: &mut impl Visit) {}

            #[inline(always)]
            unsafe fn finish(self: Pin<&mut Self>, _: u32, _: impl Finish) -> Option<$output> {
                $result
            }
        }
    };
}

end_of_list!(
    Nil,
    Never,
    false,
    unreachable!("an alternative has chosen a guard that it does not have")
);
end_of_list!(Skip, (), true, Some(()));

impl<P: Place, R> Cons<P, R> {
    #[inline(always)]
    fn parts(self: Pin<&mut Self>) -> (Option<Pin<&mut P::Guard>>, Pin<&mut R>) {
        // SAFETY: both fields are pinned with the whole.
        unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.0).open(),
                Pin::new_unchecked(&mut this.1),
            )
        }
    }
}

impl<P: Place, R: Guards> Guards for Cons<P, R> {
    type Output = Either<<P::Guard as Guard>::Output, R::Output>;
    const LEN: usize = R::LEN + 1;
    const DROPS: bool = P::Guard::DROPS || R::DROPS;
    const SKIP: bool = R::SKIP;
    const PLAIN: bool = P::Guard::PLAIN && R::PLAIN;

    #[inline]
    fn collect<'a>(self: Pin<&'a mut Self>, number: u32, into: &mut Collected<'a>) {
        let (first, rest) = self.parts();
        if let Some(guard) = first {
            into.0.push((number, guard));
        }
        rest.collect(number + 1, into);
    }

    #[inline(always)]
    fn each(self: Pin<&mut Self>, number: u32, step: &mut impl Visit) {
        let (first, rest) = self.parts();
        if let Some(first) = first
            && !step.visit(number, first)
        {
            return;
        }
        rest.each(number + 1, step);
    }

    #[cfg_attr(not(debug_assertions), inline(always))]
    unsafe fn finish(self: Pin<&mut Self>, index: u32, step: impl Finish) -> Option<Self::Output> {
        let (first, rest) = self.parts();
        match (index.checked_sub(1), first) {
            // SAFETY: the guard of this index is as `step` demands, as is demanded here.
            (None, Some(first)) => Some(Either::L(unsafe { step.finish(first) }?)),
            (None, None) => unreachable!("an alternative has chosen a guard that is not open"),
            // SAFETY: the guard of this index in the rest is as `step` demands, as is demanded
            // here.
            (Some(index), _) => Some(Either::R(unsafe { rest.finish(index, step) }?)),
        }
    }
}
