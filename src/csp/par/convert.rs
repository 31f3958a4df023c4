//! Branches with errors of any type, by autoref specialization: a method of that name is looked for
//! on `&&Branch`, then on `&&&Branch`, then on `&Branch`.

use crate::error::{Error, Result};
use std::cell::Cell;
use std::future::{Future, Pending};
use std::pin::Pin;
use std::task::{Context, Poll};

/// A branch on its way through autoref specialization: it never outlives the macro's expression.
pub struct Branch<F>(Cell<Option<F>>);

luna_platform::debug_fields!(impl[F] Branch<F>);

/// What a branch gives: a `Result`, with an error that turns into [`Error`].
#[diagnostic::on_unimplemented(
    message = "a branch of `par!` gives `{Self}`, where a `Result` is expected",
    label = "this branch gives no `Result`",
    note = "a branch is a future with output `Result<T, E>`, where `E` turns into `luna::Error`; an async block ends in \
            `Ok(())`, or in `Ok(value)`, and has no `;` behind it"
)]
pub trait Outcome {}

impl<T, E: Into<Error>> Outcome for Result<T, E> {}

impl<F: Future> Branch<F>
where
    F::Output: Outcome,
{
    /// Takes the branch as it was written. Its bounds are checked here, where the compiler points
    /// at it.
    pub fn new(branch: F) -> Self {
        Branch(Cell::new(Some(branch)))
    }
}

impl<F> Branch<F> {
    fn take(&self) -> F {
        self.0.take().expect("the macro takes each branch once")
    }
}

/// A branch with an error that is, or can still be inferred to be, [`Error`].
pub trait Exact {
    /// The branch.
    type Branch;
    /// Takes it as it is.
    fn branch(self) -> Self::Branch;
}

impl<F: Future<Output = Result<T>>, T> Exact for &&Branch<F> {
    type Branch = F;
    fn branch(self) -> F {
        self.take()
    }
}

/// A branch with any other error.
pub trait Converted {
    /// The branch with its error converted.
    type Branch;
    /// Converts its error.
    fn branch(self) -> Self::Branch;
}

impl<F, T, E> Converted for &&&Branch<F>
where
    F: Future<Output = Result<T, E>>,
    E: Into<Error>,
{
    type Branch = Converting<F>;
    fn branch(self) -> Converting<F> {
        Converting(self.take())
    }
}

/// What is no branch, which [`Branch::new`] has reported already: this keeps the compiler from
/// reporting it a second time.
pub trait Refused {
    /// Something with which it can go on.
    fn branch<T>(self) -> Pending<Result<T>>;
}

impl<F> Refused for &Branch<F> {
    fn branch<T>(self) -> Pending<Result<T>> {
        std::future::pending()
    }
}

/// Turns a branch's error into [`Error`].
pub struct Converting<F>(F);

luna_platform::debug_fields!(impl[F] Converting<F>);

impl<F, T, E> Future for Converting<F>
where
    F: Future<Output = Result<T, E>>,
    E: Into<Error>,
{
    type Output = Result<T>;

    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Result<T>> {
        // SAFETY: the branch is pinned with the whole.
        let branch = unsafe { self.map_unchecked_mut(|this| &mut this.0) };
        branch.poll(cx).map(|outcome| outcome.map_err(Into::into))
    }
}
