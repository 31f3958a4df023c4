//! What an alternative may offer.

use crate::select_state::SelectState;
use crate::stamp::Stamp;
use crate::wait_point::{WaitPoint, WaitQueues};
use luna_core::current::{PendingWake, PlainPendingWake, Process};
use luna_platform::clock::Instant;
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll};

/// An operation that an alternative may offer: what `recv`, `recv_extended`, `send`, `send_from`,
/// `send_with`, `after` and `at` return, and a barrier's `sync`.
///
/// Sealed: a guard is decided under the locks of all that is offered, so that exactly one happens.
/// Any other future as a guard would either lose what it had done when another was chosen, or have
/// to be polled on.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a guard",
    label = "an alternative takes `recv()`, `send(..)`, `sync()` or `luna::after(..)`, not any future",
    note = "a guard is the operation itself, without `.await`",
    note = "put other work in the body, or in a process of its own that answers over a channel"
)]
pub trait Guard: RawGuard {
    /// Output of the guard when it is chosen.
    type Output;

    /// Whether a guard that was not chosen and is listed nowhere, or that has given its output, has
    /// anything to drop.
    #[doc(hidden)]
    const DROPS: bool = true;

    /// What the guard is made of: as small as can be, since it is moved until the alternative is
    /// polled.
    #[doc(hidden)]
    type Seed;

    /// Takes a new guard for its seed.
    #[doc(hidden)]
    fn into_seed(self) -> Self::Seed;

    /// Makes the guard that the seed was.
    #[doc(hidden)]
    fn from_seed(seed: Self::Seed) -> Self;

    /// Takes the guard's output.
    ///
    /// # Safety
    ///
    /// The guard was chosen, [`poll_chosen`](RawGuard::poll_chosen) was ready, and this is called
    /// once.
    #[doc(hidden)]
    unsafe fn output(self: Pin<&mut Self>) -> Self::Output;
}

/// Result of an attempt.
#[derive(Debug)]
pub enum Attempt {
    /// The guard cannot happen now.
    NotReady,
    /// It has happened. The `PendingWake` is to be woken when the locks are released.
    Ready(PendingWake),
}

/// Result of a look at a guard on the fast path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// It cannot be had that way: the place is not locked.
    No,
    /// It would have to wait. The place stays locked.
    NotReady,
    /// It can happen. The place stays locked.
    Ready,
}

/// The steps of an alternative that do not depend on the guard's output. They are unsafe to call,
/// since `Guard` brings them wherever it is a bound: an alternative calls them in their order.
pub trait RawGuard {
    /// Where it is decided; none for one that depends on the clock alone. It outlives the guard.
    fn place(&self) -> Option<NonNull<WaitPoint>>;

    /// Whether the guard can happen at all. Asked only while it is new.
    fn is_open(&self) -> bool {
        true
    }

    /// When its end was last chosen.
    fn stamp(&self) -> Option<&Stamp> {
        None
    }

    /// From when on it is ready, if that is known for certain: for a delay.
    fn deadline(&self) -> Option<Instant> {
        None
    }

    /// Whether a partner may claim several alternatives at once to make it happen.
    fn claims_several(&self) -> bool {
        false
    }

    /// Makes the guard happen at once, if possible. O(1) for channels.
    ///
    /// # Safety
    ///
    /// `lists` are those of its place. The guard is new: it is listed nowhere and has not happened.
    unsafe fn attempt(
        self: Pin<&mut Self>,
        lists: Option<&mut WaitQueues>,
        cx: &mut Context<'_>,
    ) -> Attempt;

    /// Lists the guard at its wait point, as number `guard` of `selection`.
    ///
    /// # Safety
    ///
    /// As for `attempt`; and `selection` outlives the guard's being listed.
    unsafe fn list(
        self: Pin<&mut Self>,
        lists: &mut WaitQueues,
        selection: NonNull<SelectState>,
        guard: u32,
    );

    /// Takes the guard off its list, if it is still there: another one was chosen, or none.
    ///
    /// # Safety
    ///
    /// Its alternative calls this, and the guard's own future was not polled.
    unsafe fn withdraw(self: Pin<&mut Self>);

    /// Whether the guard, which was chosen, is over.
    ///
    /// # Safety
    ///
    /// As for `withdraw`; and the guard was chosen.
    unsafe fn poll_chosen(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()>;

    /// Called when the lock of its place was released after `attempt` or `list`.
    fn released(&self) {}

    /// The current process, which has a replay log, is about to look at it.
    fn note_logged(&self) {}

    /// The stamp of a chosen guard that was listed, of a process with a replay log; 0 if it has
    /// none.
    fn order(&self) -> u64 {
        0
    }

    /// Whether the guard's time has come, for one that has no place; arranges for a wake at that
    /// time.
    ///
    /// # Safety
    ///
    /// As for `withdraw`.
    unsafe fn poll_time(self: Pin<&mut Self>, _cx: &mut Context<'_>) -> Poll<()> {
        Poll::Pending
    }

    /// Locks the guard's wait point if it is biased to this executor, and reports whether the guard
    /// can happen. Unless the answer is [`No`](Look::No), the lock is kept until
    /// [`leave_home`](Self::leave_home), [`take_fast`](Self::take_fast) or
    /// [`list_fast`](Self::list_fast). This is the fast path of the common kinds of guards. Support
    /// is optional.
    ///
    /// # Safety
    ///
    /// As for `attempt`; and this thread is the executor of that number.
    unsafe fn look_fast(self: Pin<&mut Self>, _home: u64) -> Look {
        Look::No
    }

    /// Releases the wait point's lock.
    ///
    /// # Safety
    ///
    /// The look on this executor has kept the lock.
    unsafe fn leave_home(self: Pin<&mut Self>, _home: u64) {}

    /// Makes the guard happen, and releases the lock. Returns the process to wake.
    ///
    /// # Safety
    ///
    /// The look has kept the lock, and said that the guard is ready. `process` has its plain turn.
    unsafe fn take_fast(self: Pin<&mut Self>, _process: &Process) -> Option<PlainPendingWake> {
        None
    }

    /// Lists the guard as number `guard` of `selection`, and releases the lock.
    ///
    /// # Safety
    ///
    /// The look has kept the lock, and said that the guard is not ready. `process` has its plain
    /// turn. `selection` outlives the guard's being listed.
    unsafe fn list_fast(
        self: Pin<&mut Self>,
        _process: &Process,
        _selection: NonNull<SelectState>,
        _guard: u32,
    ) {
    }

    /// As [`withdraw`](Self::withdraw), wherever the guard was listed.
    ///
    /// # Safety
    ///
    /// As for `withdraw`; and this thread is the executor of that number.
    unsafe fn withdraw_fast(self: Pin<&mut Self>, _home: u64) {
        // SAFETY: the contract.
        unsafe { self.withdraw() };
    }

    /// Whether the guard, which was chosen, is over, so that [`output`](Guard::output) can be
    /// called at once.
    fn is_over(&self) -> bool {
        false
    }

    /// Whether the guard has an error to return.
    fn can_fail(&self) -> bool {
        false
    }

    /// Makes the guard fail as poisoned. Returns whether it can.
    ///
    /// # Safety
    ///
    /// As for `withdraw`; and the guard is listed nowhere.
    unsafe fn fail(self: Pin<&mut Self>) -> bool;
}
