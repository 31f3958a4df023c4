//! What an alternative may offer.

use crate::select_state::SelectState;
use crate::stamp::Stamp;
use crate::wait_point::{WaitPoint, WaitQueues};
use core::pin::Pin;
use core::ptr::NonNull;
use core::task::{Context, Poll};
use luna_core::current::PendingWake;
use luna_core::wait_list::WaitNode;
use luna_platform::clock::Instant;

/// An operation that an alternative may offer: what `recv`, `recv_extended`, `send`, `send_from`,
/// `send_with`, `after` and `at` return, a barrier's `sync`, a client's `call`, and what falls due
/// on the clock (ticks, timers).
///
/// Sealed: a guard is decided under the locks of all that is offered, so that exactly one happens.
/// Any other future as a guard would either lose what it had done when another was chosen, or have
/// to be polled on.
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

    /// Whether the guard can happen at all. Asked only while it is new.
    #[doc(hidden)]
    #[inline(always)]
    fn is_open(&self) -> bool {
        true
    }

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

/// The seed of a guard that is small: the guard itself.
macro_rules! own_seed {
    () => {
        type Seed = Self;

        #[inline]
        fn into_seed(self) -> Self {
            self
        }

        #[inline]
        fn from_seed(seed: Self) -> Self {
            seed
        }
    };
}

pub(crate) use own_seed;

/// What an alternative considers of a guard: asked once, so that a look at it calls nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Terms {
    /// Where it is decided; none for one that depends on the clock alone. It outlives the guard.
    pub(crate) wait_point: Option<NonNull<WaitPoint>>,
    /// When its end was last chosen; none for one without a wait point. It outlives the guard.
    pub(crate) stamp: Option<NonNull<Stamp>>,
    /// The node of a plain guard: a send without a closure, or a receive that holds no sender. It
    /// is that of a waiter, which a partner in a plain turn may meet where it waits alone. Such a
    /// guard also has a stamp, and [`note_begun`](RawGuard::note_begun).
    pub(crate) plain: Option<NonNull<WaitNode>>,
    pub(crate) of_sender: bool,
    /// Whether it is chosen, and [fails](RawGuard::fail), when a sibling branch has failed. A call
    /// does not: the branch ends instead.
    pub(crate) can_fail: bool,
}

impl Terms {
    /// Of an operation at `wait_point`, through an end with this stamp.
    #[inline(always)]
    pub(crate) fn at(wait_point: &WaitPoint, stamp: &Stamp) -> Self {
        Self {
            wait_point: Some(NonNull::from(wait_point)),
            stamp: Some(NonNull::from(stamp)),
            ..Self::default()
        }
    }
}

/// The steps of an alternative that do not depend on the guard's output. They are unsafe to call,
/// since `Guard` brings them wherever it is a bound: an alternative calls them in their order.
///
/// ```text
///   terms --> attempt --ready-------------------------> poll_chosen --> output
///                |                                          ^
///                '--> list (poll_time without a wait point) -- chosen
///                        '-- another was chosen --> withdraw
/// ```
///
/// # Safety
///
/// The wait point and the stamp of its terms outlive the guard, and its plain node is its own; one
/// with a plain node has both. A guard that is dropped while it is listed takes its node off the
/// list. The default methods suit a guard without a wait point. One that has a wait point brings
/// its own `list`, `withdraw` and `poll_chosen`.
pub unsafe trait RawGuard {
    /// What is to be considered. The same in all calls.
    fn terms(&self) -> Terms;

    /// When its end was last chosen, for one without a wait point that remembers that.
    fn stamp(&self) -> Option<&Stamp> {
        None
    }

    /// From when on it is ready, if that is known for certain: for a delay.
    fn deadline(&self) -> Option<Instant> {
        None
    }

    /// Makes the guard happen at once, if possible. O(1) for channels.
    ///
    /// # Safety
    ///
    /// `lists` are those of its wait point. The guard is new: it is listed nowhere and has not
    /// happened.
    unsafe fn attempt(
        self: Pin<&mut Self>,
        lists: Option<&mut WaitQueues>,
        cx: &mut Context<'_>,
    ) -> Attempt;

    /// Lists the guard at its wait point, as number `guard` of `select_state`.
    ///
    /// # Safety
    ///
    /// As for `attempt`; and `select_state` outlives the guard's being listed.
    unsafe fn list(
        self: Pin<&mut Self>,
        _lists: &mut WaitQueues,
        _select_state: NonNull<SelectState>,
        _guard: u32,
    ) {
    }

    /// Takes the guard off its list, if it is still there: another one was chosen, or none.
    ///
    /// # Safety
    ///
    /// Its alternative calls this, and the guard's own future was not polled.
    unsafe fn withdraw(self: Pin<&mut Self>) {}

    /// Whether the guard, which was chosen, is over.
    ///
    /// # Safety
    ///
    /// As for `withdraw`: its alternative calls this, and the guard's own future was not polled.
    /// The guard was chosen.
    unsafe fn poll_chosen(self: Pin<&mut Self>, _cx: &mut Context<'_>) -> Poll<()> {
        Poll::Ready(())
    }

    /// Called when the lock of its wait point was released after `attempt` or `list`.
    fn released(&self) {}

    /// The current process, which has a replay log, is about to look at it.
    fn note_logged(&self) {}

    /// The stamp of a chosen guard that was listed, of a process with a replay log; 0 if it has
    /// none.
    ///
    /// # Safety
    ///
    /// As for `withdraw`: its alternative calls this, and the guard's own future was not polled.
    unsafe fn order(&self) -> u64 {
        0
    }

    /// Whether the guard's time has come, for one that has no wait point; arranges for a wake at
    /// that time.
    ///
    /// # Safety
    ///
    /// As for `withdraw`: its alternative calls this, and the guard's own future was not polled.
    unsafe fn poll_time(self: Pin<&mut Self>, _cx: &mut Context<'_>) -> Poll<()> {
        Poll::Pending
    }

    /// Makes the guard fail as poisoned. Returns whether it can.
    ///
    /// # Safety
    ///
    /// As for `withdraw`: its alternative calls this, and the guard's own future was not polled.
    /// The guard is listed nowhere.
    unsafe fn fail(self: Pin<&mut Self>) -> bool {
        false
    }

    /// It is plain, and its node knows what has come of it: it waits there without
    /// [`list`](Self::list), or was met without [`attempt`](Self::attempt).
    ///
    /// # Safety
    ///
    /// As for `withdraw`: its alternative calls this, and the guard's own future was not polled.
    /// The node was begun.
    unsafe fn note_begun(self: Pin<&mut Self>) {}
}
