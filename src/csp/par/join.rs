//! The branches of a parallel construct, in their places.

use crate::error::{Error, Failures, Result};
use luna_core::current;
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

/// The future of [`par!`](crate::par), and of [`pri_par!`](crate::pri_par) where `BY_PRIORITY`:
/// branches and their values.
#[must_use = "a parallel construct does nothing unless awaited"]
pub struct Join<T, const BY_PRIORITY: bool> {
    branches: T,
    failed: bool,
}

luna_platform::debug_fields!(
    impl[T, const BY_PRIORITY: bool] Join<T, BY_PRIORITY>, |join|
    failed: join.failed
);

/// Used by the macros.
pub fn join<const BY_PRIORITY: bool, T: Branches>(branches: T) -> Join<T::Slots, BY_PRIORITY> {
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

/// A branch, or what it came to, until that is taken.
enum State<F, T> {
    Running(F),
    Done(Option<Result<T>>),
}

/// A branch in its place. Pinned with the whole.
pub struct Slot<F, T>(State<F, T>);

impl<F, T> Slot<F, T> {
    pub(super) fn new(branch: F) -> Self {
        Slot(State::Running(branch))
    }

    pub(super) fn is_running(&self) -> bool {
        matches!(self.0, State::Running(_))
    }
}

luna_platform::debug_fields!(impl[F, T] Slot<F, T>);

impl<F: Future<Output = Result<T>>, T> Slot<F, T> {
    /// Polls the branch once if it runs, the one of this number, `below` levels lower than its
    /// construct. Returns whether it runs on, and notes in `failed` that it has just failed.
    #[inline]
    pub(super) fn poll(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        below: u8,
        number: u32,
        failed: &mut bool,
    ) -> bool {
        // SAFETY: a running branch is polled in its place, and dropped there when it is
        // overwritten.
        let state = unsafe { &mut self.get_unchecked_mut().0 };
        let State::Running(branch) = state else {
            return false;
        };
        // SAFETY: the slot is pinned, and the branch stays in it until it is dropped there.
        let branch = unsafe { Pin::new_unchecked(branch) };
        if *failed || current::branch_failed() {
            // An end that a panic has left behind belongs to no branch.
            current::take_branch_end();
        }
        let polled = current::with_branch_below(*failed, below, number, || branch.poll(cx));
        let is_over = (*failed || current::branch_failed()) && current::take_branch_end();
        match polled {
            Poll::Pending if is_over => {
                *failed = true;
                // Dropped where it waits.
                current::with_branch_below(*failed, below, number, || {
                    current::with_abandoned(|| *state = State::Done(Some(Err(Error::Poisoned))));
                });
                false
            }
            Poll::Pending => true,
            Poll::Ready(outcome) => {
                *failed |= outcome.is_err();
                // Drops the branch, and with it its channel ends, before the siblings go on.
                *state = State::Done(Some(outcome));
                false
            }
        }
    }

    /// Takes what it came to.
    ///
    /// # Panics
    ///
    /// If it runs, or was taken before.
    pub(super) fn take(self: Pin<&mut Self>) -> Result<T> {
        // SAFETY: an outcome is not pinned.
        let outcome = match unsafe { &mut self.get_unchecked_mut().0 } {
            State::Done(outcome) => outcome.take(),
            State::Running(_) => None,
        };
        outcome.expect("a parallel construct was polled after it had ended")
    }
}

/// One turn of all branches.
struct Turn<'a, const BY_PRIORITY: bool> {
    failed: &'a mut bool,
    running: bool,
    /// How many levels the next branch runs below the construct.
    below: u8,
    /// The next branch's number.
    number: u32,
    /// What is more urgent than the next branch runs first.
    gave_way: bool,
}

impl<'a, const BY_PRIORITY: bool> Turn<'a, BY_PRIORITY> {
    #[inline]
    fn new(failed: &'a mut bool) -> Self {
        Turn {
            failed,
            running: false,
            below: 0,
            number: 0,
            gave_way: false,
        }
    }

    #[inline]
    fn poll<F: Future<Output = Result<T>>, T>(
        &mut self,
        mut slot: Pin<&mut Slot<F, T>>,
        cx: &mut Context<'_>,
    ) {
        if !BY_PRIORITY {
            self.running |= slot.poll(cx, 0, self.number, self.failed);
            self.number += 1;
            return;
        }
        if !self.gave_way && self.below > 0 && slot.is_running() {
            // The process may have been given its turn for a more urgent branch. Whether this one
            // has anything to do is not known, so the process comes again at this one's level.
            self.gave_way = current::with_branch_below(false, self.below, self.number, || {
                current::yield_if_outranked(cx)
            });
        }
        self.running |= if self.gave_way {
            slot.is_running()
        } else {
            slot.as_mut().poll(cx, self.below, self.number, self.failed)
        };
        self.below += 1;
        self.number += 1;
    }
}

macro_rules! joins {
    ($($branch:ident $value:ident $slot:ident),+) => {
        impl<$($branch: Future<Output = Result<$value>>, $value),+> Branches for ($($branch,)+) {
            type Slots = ($(Slot<$branch, $value>,)+);
            fn into_slots(self) -> Self::Slots {
                let ($($slot,)+) = self;
                ($(Slot::new($slot),)+)
            }
        }

        impl<$($branch: Future<Output = Result<$value>>, $value,)+ const BY_PRIORITY: bool> Future for Join<($(Slot<$branch, $value>,)+), BY_PRIORITY> {
            type Output = Result<($($value,)+)>;

            fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
                // SAFETY: the slots are pinned with the whole.
                let this = unsafe { self.get_unchecked_mut() };
                let ($($slot,)+) = &mut this.branches;
                // SAFETY: the slots are pinned with the whole, and are polled where they are.
                $(let mut $slot = unsafe { Pin::new_unchecked($slot) };)+
                loop {
                    let failed_before = this.failed;
                    let mut turn = Turn::<BY_PRIORITY>::new(&mut this.failed);
                    $(turn.poll($slot.as_mut(), cx);)+
                    let running = turn.running;
                    // Notify the siblings of a branch that has just failed; that happens once.
                    if running && this.failed == failed_before {
                        return Poll::Pending;
                    }
                    if !running {
                        break;
                    }
                }
                if !this.failed {
                    let mut values = || Ok(($($slot.as_mut().take()?,)+));
                    return Poll::Ready(values());
                }
                let mut failures = Failures::default();
                $(failures.add($slot.take().err());)+
                Poll::Ready(Err(failures.take_error().expect("not all branches have ended well")))
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
