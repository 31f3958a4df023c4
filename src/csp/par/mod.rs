//! Parallel constructs.

mod collection;
mod join;
use crate::error::{Error, Result};
pub use collection::{ParAll, par_all, par_for};
pub use join::{Branches, Join, Slot, join};
use std::cell::Cell;
use std::future::{Future, Pending};
use std::pin::Pin;
use std::task::{Context, Poll};

/// Runs branches in parallel and waits for all of them: CSP's parallel composition, occam's `PAR`.
///
/// The branches are futures with output `Result<T, E>`, where `E` turns into
/// [`Error`](crate::Error); one to twelve of them. They may borrow from their surroundings, since
/// they run as part of their parent, polled in the order written. When all have ended the value is
/// the tuple of theirs. See [`par_all`] for collections of branches, [`pri_par!`](crate::pri_par)
/// for branches of falling priority.
///
/// # Errors
///
/// A branch that fails marks its siblings: their pending and later channel operations fail as
/// poisoned, so that they end too, and what they return then are their errors. If one branch alone
/// has failed, the error is that branch's; else it is [`Error::Several`](crate::Error::Several)
/// with all of them in the order written ([`Error::errors`](crate::Error::errors)). Neither depends
/// on the order in which the branches failed. A branch that waits for something else than a channel
/// ([`after`](crate::after()), a [periodic loop](crate::periodic()), a file) goes on to wait, and
/// ends at its next channel operation: give it one, or bound the wait.
///
/// Real-time path: yes. Each wake of the parent costs O(branches). Nothing is allocated, whatever
/// the branches come to, but if several fail and one of them with an error that is allocated
/// itself; see [`Several`](crate::error::Several). Cancel-safe: dropping it drops all branches.
///
/// ```
/// use luna::prelude::*;
///
/// let total = luna::run(async {
///     let (sender, receiver) = luna::channel();
///     let (_, sum) = par!(
///         async move {
///             for n in 1..=10 {
///                 sender.send(n).await?;
///             }
///             Ok(())
///         },
///         async {
///             let mut sum = 0;
///             while let Ok(n) = receiver.recv().await {
///                 sum += n;
///             }
///             Ok(sum)
///         },
///     )
///     .await?;
///     Ok(sum)
/// })?;
/// assert_eq!(total, 55);
/// # Ok::<(), luna::Error>(())
/// ```
///
/// A branch that gives no `Result` is refused when the program is compiled:
///
/// ```compile_fail,E0277
/// use luna::prelude::*;
///
/// luna::run(async {
///     par!(async { Ok(()) }, async { println!("no Ok(()) here") }).await?;
///     Ok(())
/// })?;
/// # Ok::<(), luna::Error>(())
/// ```
#[doc(alias = "join")]
#[macro_export]
macro_rules! par {
    ($($branch:expr),+ $(,)?) => {
        $crate::__par_of!(false, $($branch),+)
    };
}

/// Runs branches in parallel by falling priority: occam's `PRI PAR`. As [`par!`](crate::par), but
/// the first branch is the most urgent.
///
/// On an executor, branch *i* (from 0) runs *i* levels below its parent, but not below level 0: it
/// waits in channels with that level, a process between it and the branch above it runs before it,
/// and a wake of it queues the parent at its level (at the level of the most urgent branch, if
/// several are ready). A branch above it that lets others run ([`yield_now`](crate::yield_now), a
/// wake of itself) comes again before it. Within a nested construct levels fall on from the
/// branch's. In [`run`](crate::run) there are no levels, and only the order of the branches
/// remains: it is the one in which those that can go on do so.
///
/// A wake from another thread readies the parent at its own level, since it comes through its
/// waker; what is less urgent than other ready processes then gives way before it runs. A branch of
/// a combinator within a branch (`join`, `select` of other crates) is woken at the parent's level,
/// too.
///
/// Errors, values, real-time path and cancel-safety are those of [`par!`](crate::par). Giving way
/// costs one more poll of the branches above.
///
/// ```
/// use luna::prelude::*;
/// use std::cell::RefCell;
///
/// let order = RefCell::new(Vec::new());
/// let step = async |name| {
///     for _ in 0..2 {
///         order.borrow_mut().push(name);
///         luna::yield_now().await;
///     }
///     Ok::<_, luna::Error>(())
/// };
/// luna::run(async { pri_par!(step("first"), step("second")).await })?;
/// assert_eq!(order.into_inner(), ["first", "second", "first", "second"]);
/// # Ok::<(), luna::Error>(())
/// ```
#[macro_export]
macro_rules! pri_par {
    ($($branch:expr),+ $(,)?) => {
        $crate::__par_of!(true, $($branch),+)
    };
}

/// Common body of both macros: the flag sets whether priorities fall.
#[doc(hidden)]
#[macro_export]
macro_rules! __par_of {
    ($by_priority:literal, $($branch:expr),+) => {{
        // Chooses by autoref, for any error of the branch: taken as it is if it is `luna::Error` or
        // still open, else converted.
        #[allow(unused_imports, reason = "which of them is needed depends on the branches")]
        use $crate::__par::{Converted as _, Exact as _, Refused as _};
        $crate::__par::join::<$by_priority, _>(($((&&$crate::__par::Branch::new($branch)).branch(),)+))
    }};
}

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
