//! The guards of one alternative, as a list whose type knows each of them.

use super::guard::{Guard, RawGuard};
use arrayvec::ArrayVec;
use std::pin::Pin;

/// How many guards one `alt!` can have. More are for an [`Alternative`](crate::Alternative), which also costs less for many.
pub(super) const MOST_GUARDS: usize = 32;

/// The guards whose preconditions hold, with their numbers in the order written.
pub(super) type Open<'a> = ArrayVec<(u32, Pin<&'a mut (dyn RawGuard + 'a)>), MOST_GUARDS>;

/// What the first guard gave, or what one of the rest gave.
#[derive(Debug)]
pub enum Either<L, R> {
    /// The first.
    L(L),
    /// One of the rest.
    R(R),
}

/// What no guard gives.
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

/// Takes a guard as it is; the bound is checked here, at the guard's own expression.
#[inline]
pub fn guard<G: Guard>(guard: G) -> G {
    guard
}

/// A list of guards.
pub trait Guards {
    /// What the chosen one gives.
    type Output;
    /// How many there are.
    const LEN: usize;
    /// Whether `skip` stands at the end.
    const SKIP: bool;

    /// Adds the guards that can happen; the others go when this is called for the `first` time, before any is listed.
    fn collect<'a>(self: Pin<&'a mut Self>, first: bool, number: u32, into: &mut Collected<'a>);

    /// What guard `index` gives, or `skip` if that many it has.
    ///
    /// # Safety
    ///
    /// That guard was chosen and is over, and this is called once.
    unsafe fn output(self: Pin<&mut Self>, index: u32) -> Self::Output;
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
    const SKIP: bool = false;

    fn collect<'a>(self: Pin<&'a mut Self>, _: bool, _: u32, _: &mut Collected<'a>) {}

    unsafe fn output(self: Pin<&mut Self>, _: u32) -> Never {
        unreachable!("an alternative has chosen a guard that it does not have")
    }
}

impl Guards for Skip {
    type Output = ();
    const LEN: usize = 0;
    const SKIP: bool = true;

    fn collect<'a>(self: Pin<&'a mut Self>, _: bool, _: u32, _: &mut Collected<'a>) {}

    unsafe fn output(self: Pin<&mut Self>, _: u32) {}
}

impl<G: Guard, R: Guards> Guards for Cons<G, R> {
    type Output = Either<G::Output, R::Output>;
    const LEN: usize = R::LEN + 1;
    const SKIP: bool = R::SKIP;

    #[inline]
    fn collect<'a>(self: Pin<&'a mut Self>, first: bool, number: u32, into: &mut Collected<'a>) {
        // SAFETY: both fields are pinned with the whole.
        let (mut guard, rest) = unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.0),
                Pin::new_unchecked(&mut this.1),
            )
        };
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
    unsafe fn output(self: Pin<&mut Self>, index: u32) -> Self::Output {
        // SAFETY: both fields are pinned with the whole.
        let (first, rest) = unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.0),
                Pin::new_unchecked(&mut this.1),
            )
        };
        match (index.checked_sub(1), first.as_pin_mut()) {
            // SAFETY: the contract.
            (None, Some(first)) => Either::L(unsafe { first.output() }),
            (None, None) => unreachable!("an alternative has chosen a guard that is not open"),
            // SAFETY: the contract.
            (Some(index), _) => Either::R(unsafe { rest.output(index) }),
        }
    }
}
