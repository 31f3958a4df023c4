//! Parallel constructs over collections.

use super::join::Slot;
use crate::error::{Failures, Result};
use luna_core::current::{self, Branches, OPERATIONS_PER_POLL};
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

/// Runs all branches of a collection in parallel and waits for all of them: [`par!`](crate::par)
/// for any number of branches of one kind.
///
/// The branches are futures with output [`luna::Result<T>`](crate::Result); they may borrow from
/// their surroundings. When all have ended the value is the vector of theirs, in the collection's
/// order. Errors are those of [`par!`](crate::par), in the collection's order. An empty collection
/// is done at once.
///
/// Real-time path: its creation allocates, once for the whole collection and at a cost of
/// O(branches) (the vector of the values too), and its drop frees: make it before the time counts.
/// In between it allocates nothing, as far as `par!` does not. A wake of a branch costs O(1), and
/// the parent's turn polls only branches that were woken: O(these + branches / 4096). The first
/// failure has all others polled once. After 64 polls, and when a process of higher level is ready,
/// the parent lets others run. Cancel-safe: dropping it drops all branches.
///
/// ```
/// let branches: Vec<_> = (1..=3).map(async |n: u32| Ok(n * n)).collect();
/// let squares = luna::run(async { luna::par_all(branches).await })?;
/// assert_eq!(squares, [1, 4, 9]);
/// # Ok::<(), luna::Error>(())
/// ```
pub fn par_all<I, F, T>(branches: I) -> ParAll<F, T>
where
    I: IntoIterator<Item = F>,
    F: Future<Output = Result<T>>,
{
    let slots: Box<[Slot<F, T>]> = branches.into_iter().map(Slot::new).collect();
    let all = slots.len();
    let branches = Branches::new(all);
    branches.wake_all();
    ParAll {
        values: Vec::with_capacity(all),
        failures: Failures::with_room_for(all),
        running: all,
        failed: false,
        is_over: false,
        branches,
        slots: Box::into_pin(slots),
    }
}

/// Runs `body` for each item of a collection, all in parallel: occam's replicated `PAR`. See
/// [`par_all`], of which it has all properties.
///
/// ```
/// let (sender, receiver) = luna::buffered(luna::Buffer::fifo(3));
/// luna::run(async { luna::par_for([10, 20, 30], async |n| Ok(sender.send(n).await?)).await })?;
/// assert_eq!(receiver.try_recv(), Ok(10));
/// # Ok::<(), luna::Error>(())
/// ```
pub fn par_for<I, B, F, T>(items: I, body: B) -> ParAll<F, T>
where
    I: IntoIterator,
    B: FnMut(I::Item) -> F,
    F: Future<Output = Result<T>>,
{
    par_all(items.into_iter().map(body))
}

/// The branches of a collection, running: see [`par_all`] and [`par_for`].
#[must_use = "a parallel construct does nothing unless awaited: add `.await`"]
pub struct ParAll<F, T> {
    slots: Pin<Box<[Slot<F, T>]>>,
    values: Vec<T>,
    failures: Failures,
    running: usize,
    failed: bool,
    is_over: bool,
    branches: Branches,
}

// The branches are pinned in their own allocation, and values are not pinned at all.
impl<F, T> Unpin for ParAll<F, T> {}

luna_platform::debug_fields!(
    impl[F, T] ParAll<F, T>, |all|
    branches: all.slots.len(),
    running: all.running,
    failed: all.failed
);

impl<F: Future<Output = Result<T>>, T> ParAll<F, T> {
    fn poll_branch(&mut self, branch: usize) {
        // SAFETY: the slot stays in its place.
        let slots = unsafe { self.slots.as_mut().get_unchecked_mut() };
        let slot = &mut slots[branch];
        if !slot.is_running() {
            return;
        }
        let failed_before = self.failed;
        let failed = &mut self.failed;
        let runs = self.branches.with_waker(branch, |cx| {
            // SAFETY: the slots are pinned.
            unsafe { Pin::new_unchecked(slot) }.poll(cx, 0, branch as u32, failed)
        });
        self.running -= usize::from(!runs);
        if self.failed != failed_before {
            // Notify the siblings; this happens once.
            self.branches.wake_all();
        }
    }

    fn outcome(&mut self) -> Result<Vec<T>> {
        let mut values = std::mem::take(&mut self.values);
        // SAFETY: the slots stay in their places.
        let slots = unsafe { self.slots.as_mut().get_unchecked_mut() };
        for slot in slots {
            // SAFETY: the slots are pinned.
            match unsafe { Pin::new_unchecked(slot) }.take() {
                Ok(value) => {
                    values.push(value);
                    self.failures.add(None);
                }
                Err(error) => self.failures.add(Some(error)),
            }
        }
        self.failures.take_error().map_or(Ok(values), Err)
    }
}

impl<F: Future<Output = Result<T>>, T> Future for ParAll<F, T> {
    type Output = Result<Vec<T>>;

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let this = &mut *self;
        assert!(
            !this.is_over,
            "a parallel construct was polled after it had ended"
        );
        this.branches.stop_waiting();
        if current::branch_failed() && !this.failed {
            // Everything in here has failed siblings outside, and is poisoned as if they were
            // inside.
            this.failed = true;
            this.branches.wake_all();
        }
        let mut polls = 0;
        while this.running > 0 {
            if polls == OPERATIONS_PER_POLL {
                // Others have their turn; if none of ours is left, the next wake comes to us.
                this.branches.wait(cx);
                return Poll::Pending;
            }
            if polls > 0 && current::yield_if_outranked(cx) {
                return Poll::Pending;
            }
            let Some(branch) = this.branches.next() else {
                this.branches.wait(cx);
                return Poll::Pending;
            };
            polls += 1;
            this.poll_branch(branch);
        }
        this.is_over = true;
        Poll::Ready(this.outcome())
    }
}
