//! The parallel construct.

use crate::error::{Error, Result};
use luna_platform::current;
use std::cell::Cell;
use std::fmt;
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

/// Runs branches in parallel and waits for all of them: CSP's parallel composition, occam's `PAR`.
///
/// The branches are futures with output `Result<T, E>`, where `E` turns into [`Error`]; two to twelve of them. They may borrow from
/// their surroundings, since they run as part of their parent, polled in the order written. When all have ended the value is
/// the tuple of theirs, or the first error in the order written.
///
/// A branch that fails marks its siblings: their pending and later channel operations fail as poisoned, so that they end too.
/// Real-time path: yes; it allocates nothing, and each wake of the parent costs O(branches). Cancel-safe: dropping it drops
/// all branches.
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
#[macro_export]
macro_rules! par {
    ($($branch:expr),+ $(,)?) => {{
        // Chooses by autoref, whatever the branch's error is: taken as it is if it is `luna::Error` or still open, else converted.
        #[allow(unused_imports, reason = "which of the two is needed depends on the branches")]
        use $crate::__par::{Converted as _, Exact as _};
        $crate::__par::join(($($crate::__par::Branch::new($branch).branch(),)+))
    }};
}

/// The future of [`par!`](crate::par): branches and their values.
#[must_use = "a parallel construct does nothing unless awaited"]
pub struct Join<T> {
    branches: T,
    failed: bool,
}

impl<T> fmt::Debug for Join<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Join")
            .field("failed", &self.failed)
            .finish_non_exhaustive()
    }
}

/// Used by the macro.
pub fn join<T: Branches>(branches: T) -> Join<T::Slots> {
    Join {
        branches: branches.into_slots(),
        failed: false,
    }
}

/// A tuple of branches.
pub trait Branches {
    /// Them with their outcomes.
    type Slots;
    /// Makes room for the outcomes.
    fn into_slots(self) -> Self::Slots;
}

/// A branch, or what it came to.
enum State<F, T> {
    Running(F),
    Done(Result<T>),
    Taken,
}

/// A branch in its place. Pinned with the whole.
pub struct Slot<F, T>(State<F, T>);

impl<F, T> fmt::Debug for Slot<F, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.0 {
            State::Running(_) => "Running",
            State::Done(_) => "Done",
            State::Taken => "Taken",
        })
    }
}

impl<F: Future<Output = Result<T>>, T> Slot<F, T> {
    /// Polls the branch once if it runs. Says whether it runs on, and notes in `failed` that it has just failed.
    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>, failed: &mut bool) -> bool {
        // SAFETY: a running branch is polled in its place, and dropped there when it is overwritten.
        let state = unsafe { &mut self.get_unchecked_mut().0 };
        let State::Running(branch) = state else {
            return false;
        };
        // SAFETY: as above.
        let branch = unsafe { Pin::new_unchecked(branch) };
        match current::with_branch(*failed, || branch.poll(cx)) {
            Poll::Pending => true,
            Poll::Ready(outcome) => {
                *failed |= outcome.is_err();
                // Drops the branch, and with it its channel ends, before the siblings go on.
                *state = State::Done(outcome);
                false
            }
        }
    }

    fn take(self: Pin<&mut Self>) -> Result<T> {
        // SAFETY: an outcome is not pinned.
        match std::mem::replace(unsafe { &mut self.get_unchecked_mut().0 }, State::Taken) {
            State::Done(outcome) => outcome,
            State::Running(_) | State::Taken => {
                panic!("a parallel construct was polled after it had ended")
            }
        }
    }
}

macro_rules! joins {
    ($($branch:ident $value:ident $slot:ident),+) => {
        impl<$($branch: Future<Output = Result<$value>>, $value),+> Branches for ($($branch,)+) {
            type Slots = ($(Slot<$branch, $value>,)+);
            fn into_slots(self) -> Self::Slots {
                let ($($slot,)+) = self;
                ($(Slot(State::Running($slot)),)+)
            }
        }

        impl<$($branch: Future<Output = Result<$value>>, $value),+> Future for Join<($(Slot<$branch, $value>,)+)> {
            type Output = Result<($($value,)+)>;

            fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
                // SAFETY: the slots are pinned with the whole.
                let this = unsafe { self.get_unchecked_mut() };
                let ($($slot,)+) = &mut this.branches;
                // SAFETY: as above.
                $(let mut $slot = unsafe { Pin::new_unchecked($slot) };)+
                loop {
                    let failed_before = this.failed;
                    let mut running = false;
                    $(running |= $slot.as_mut().poll(cx, &mut this.failed);)+
                    if !running {
                        break;
                    }
                    // The siblings of a branch that has just failed learn of it now; that happens once.
                    if this.failed == failed_before {
                        return Poll::Pending;
                    }
                }
                let outcomes = ($($slot.take(),)+);
                let ($($slot,)+) = outcomes;
                Poll::Ready(Ok(($($slot?,)+)))
            }
        }
    };
}

joins!(A TA a);
joins!(A TA a, B TB b);
joins!(A TA a, B TB b, C TC c);
joins!(A TA a, B TB b, C TC c, D TD d);
joins!(A TA a, B TB b, C TC c, D TD d, E TE e);
joins!(A TA a, B TB b, C TC c, D TD d, E TE e, F TF f);
joins!(A TA a, B TB b, C TC c, D TD d, E TE e, F TF f, G TG g);
joins!(A TA a, B TB b, C TC c, D TD d, E TE e, F TF f, G TG g, H TH h);
joins!(A TA a, B TB b, C TC c, D TD d, E TE e, F TF f, G TG g, H TH h, I TI i);
joins!(A TA a, B TB b, C TC c, D TD d, E TE e, F TF f, G TG g, H TH h, I TI i, J TJ j);
joins!(A TA a, B TB b, C TC c, D TD d, E TE e, F TF f, G TG g, H TH h, I TI i, J TJ j, K TK k);
joins!(A TA a, B TB b, C TC c, D TD d, E TE e, F TF f, G TG g, H TH h, I TI i, J TJ j, K TK k, L TL l);

/// A branch on its way through autoref specialization: it never outlives the macro's expression.
pub struct Branch<F>(Cell<Option<F>>);

impl<F> fmt::Debug for Branch<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Branch")
    }
}

impl<F> Branch<F> {
    /// Takes the branch as it was written.
    pub fn new(branch: F) -> Self {
        Branch(Cell::new(Some(branch)))
    }

    fn take(&self) -> F {
        self.0.take().expect("the macro takes each branch once")
    }
}

/// A branch whose error is, or can still be inferred to be, [`Error`].
pub trait Exact {
    /// The branch.
    type Branch;
    /// Takes it as it is.
    fn branch(self) -> Self::Branch;
}

impl<F: Future<Output = Result<T>>, T> Exact for Branch<F> {
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

impl<F, T, E> Converted for &Branch<F>
where
    F: Future<Output = Result<T, E>>,
    E: Into<Error>,
{
    type Branch = Converting<F>;
    fn branch(self) -> Converting<F> {
        Converting(self.take())
    }
}

/// Turns a branch's error into [`Error`].
pub struct Converting<F>(F);

impl<F> fmt::Debug for Converting<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Converting")
    }
}

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
