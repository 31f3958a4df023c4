//! A send or a receive under way: one operation over a [direction](Direction).
//!
//! ```text
//!   New --at once--------------------------------------------------> Over
//!    |---> GaveWay (done, and others run first) ----------------------^
//!    |---> Settled, Overwrote (under the lock, before its result) ----^
//!    '---> Listed, Logged (the node waits, or its partner settled it) ^
//! ```

mod direction;
mod guard;
mod logged;
mod slow_path;

pub use direction::{Direction, GivesUp, Receiving, RecvOp, SendOp, Sending};
pub use logged::{RecvTimeout, SendTimeout, Timed};

use crate::core::{Channel, FastPath};
use crate::end::End;
use crate::in_place::InPlace;
use crate::inspect;
use crate::replay;
use crate::select_state::SelectState;
use crate::waiter::{Outcome, Waiter};
use core::cell::UnsafeCell;
use core::fmt;
use core::future::Future;
use core::hint::cold_path;
use core::marker::PhantomPinned;
use core::pin::Pin;
use core::ptr::NonNull;
use core::task::{Context, Poll};
use luna_core::current::{PlainTurn, WakeHandle};
use luna_core::wait_list::WaitNode;

/// What an operation's future knows of it. Its partners know the [outcome](Outcome).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Not polled yet.
    New,
    /// Partners know the node: it is in a queue, waits alone or on a hand-off slot; or one of them
    /// has settled it.
    Listed,
    /// As `Listed`, and the next poll takes the slow path: a [replay log](crate::replay) is to see
    /// the outcome.
    Logged,
    /// Settled without having been listed.
    Settled(Outcome),
    /// The send is done. Its node holds the value that a full buffer dropped for it.
    Overwrote,
    /// Done; the process lets others run before it continues.
    GaveWay,
    /// The outcome was returned.
    Over,
}

/// An operation's node, and what its direction keeps beside it.
#[repr(C)]
pub struct Node<T, D> {
    /// First, so that the waiter leads to the rest.
    pub(crate) waiter: Waiter<T>,
    pub(crate) direction: D,
}

impl<T, D> fmt::Debug for Node<T, D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Node")
    }
}

/// An operation under way: [`SendOp`] or [`RecvOp`].
///
/// # Invariants
///
/// A send's node holds the value, or can make it, in `New`, and in `Listed` and `Settled` unless
/// the outcome is `Done`, `Held` or `Broken`; the answer if it is `Answered`; and another value in
/// `Overwrote`. A receive's node holds a value in `GaveWay`, and in `Listed` and `Settled` if the
/// outcome is `Done`. In `Listed` the node was begun, and is pinned.
///
/// What a plain operation touches lies together at its begin: the node ends with what is seldom
/// used.
#[must_use = "an operation does nothing unless awaited or offered in an alternative"]
#[repr(C)]
pub struct Operation<'a, T, D: Direction<T>> {
    phase: Phase,
    end: &'a End<T>,
    node: UnsafeCell<Node<T, D>>,
    _pinned: PhantomPinned,
}

// SAFETY: a listed waiter is guarded by the channel's lock wherever the future is; the value, and
// what makes it, pass between threads anyway.
unsafe impl<'a, T: Send, D: Direction<T> + Send> Send for Operation<'a, T, D> {}
// SAFETY: `&Operation` gives access to nothing.
unsafe impl<'a, T: Send, D: Direction<T> + Send> Sync for Operation<'a, T, D> {}

// SAFETY: no code of this folder moves the node, or the operation, behind a pin.
unsafe impl<'a, T, D: Direction<T>> InPlace for Operation<'a, T, D> {}

impl<'a, T, D: Direction<T>> Operation<'a, T, D> {
    #[inline]
    pub(crate) fn of(end: &'a End<T>, waiter: Waiter<T>, direction: D) -> Self {
        Operation {
            end,
            node: UnsafeCell::new(Node { waiter, direction }),
            phase: Phase::New,
            _pinned: PhantomPinned,
        }
    }

    #[inline]
    pub(crate) fn channel(&self) -> &'a Channel<T> {
        self.end.channel()
    }

    #[inline]
    fn node_pointer(&self) -> NonNull<Node<T, D>> {
        NonNull::from(&self.node).cast()
    }

    #[inline]
    pub(crate) fn waiter(&self) -> NonNull<Waiter<T>> {
        // The waiter is the first field.
        self.node_pointer().cast()
    }

    /// Until `stop` has ended.
    #[inline(always)]
    pub(crate) fn until<S>(self, stop: S) -> Timed<'a, T, D, S>
    where
        D: GivesUp<T>,
    {
        let operation = self;
        Timed { operation, stop }
    }

    /// Not to be called while the node is listed: others change it then.
    #[inline]
    fn node(&mut self) -> &mut Node<T, D> {
        // A node that is not listed, or was settled, is known to its future alone.
        self.node.get_mut()
    }

    /// Moves the value out of the node.
    ///
    /// # Safety
    ///
    /// By the type's invariants there is one. The node is not listed, and this is called once.
    #[inline(always)]
    pub(crate) unsafe fn take_value(&mut self) -> T {
        // SAFETY: there is a value, which is taken once, and the node is not listed, as is demanded
        // here: so no other thread accesses it.
        unsafe { Waiter::take_value_of(self.waiter()) }
    }

    /// Prepares the node for being listed.
    ///
    /// # Safety
    ///
    /// It is new, and pinned; its drop withdraws it.
    #[inline(always)]
    unsafe fn begin(&mut self, wait: WaitNode, select_state: Option<(NonNull<SelectState>, u32)>) {
        self.node().direction.waits();
        // SAFETY: it is new, as is demanded here: so its node is in no list, and only this future
        // knows it.
        unsafe { Waiter::begin_as(self.waiter(), wait, D::BEGUN, select_state, D::MAKE) };
    }

    /// Takes one that waits, or is held, off its list: see [`Channel::withdraw`].
    #[must_use = "the handle's drop is user code, and the caller's last step"]
    fn unlist(&self) -> (Outcome, Option<WakeHandle>) {
        debug_assert!(self.is_listed());
        // SAFETY: the node was listed on this side: no other is waited with.
        unsafe { self.channel().withdraw(self.waiter(), D::SEND) }
    }

    /// The outcome of an operation that was listed or settled.
    #[inline]
    fn outcome(&self) -> Outcome {
        match self.phase {
            Phase::Settled(outcome) => outcome,
            // SAFETY: the node lies in this future, and was begun before it was listed.
            _ => unsafe { Waiter::outcome(self.waiter()) },
        }
    }

    /// Whether it waits for a partner, or a partner that came later has settled it.
    fn is_listed(&self) -> bool {
        matches!(self.phase, Phase::Listed | Phase::Logged)
    }

    /// What an operation returns that is done or failed so.
    #[inline]
    fn settled(&mut self, outcome: Outcome) -> Result<D::Success<'a>, D::Failure> {
        match outcome {
            Outcome::Done | Outcome::Held | Outcome::Answered => {
                self.phase = Phase::Over;
                // SAFETY: by its outcome it has communicated; it is over from here on.
                unsafe { D::communicated(self, outcome) }
            }
            Outcome::Broken => {
                self.broken();
                self.settled(Outcome::Poisoned)
            }
            ending => {
                self.phase = Phase::Over;
                let poisoned = ending == Outcome::Poisoned;
                inspect::note_failure(self.channel().wait_point(), D::SEND, poisoned);
                // SAFETY: by its outcome it has failed; it is over from here on.
                Err(unsafe { D::failed(self, poisoned) })
            }
        }
    }

    /// What an operation returns that is done, and is not [answered](Direction::ANSWERED).
    #[inline(always)]
    fn done(&mut self) -> D::Success<'a> {
        self.phase = Phase::Over;
        // SAFETY: it has communicated, as the caller says, and is over from here on.
        unsafe { D::succeeded(self) }
    }

    /// The closure that was to make the value has panicked, here or on the other side: the channel
    /// is poisoned. A send panics too, since it has nothing to give back.
    #[cold]
    fn broken(&mut self) {
        self.phase = match D::SEND {
            true => Phase::Over,
            false => Phase::Settled(Outcome::Poisoned),
        };
        self.end.poison();
        if D::SEND {
            panic!("the closure of a `send_with` panicked: its channel is poisoned");
        }
    }

    /// It waits at its channel.
    #[inline(always)]
    fn waits<R>(&self) -> Poll<R> {
        self.channel().wait_point().waits();
        Poll::Pending
    }

    /// It is done, maybe in the turn in which it was to wait.
    #[inline(always)]
    fn waits_no_more(&self) {
        self.channel().wait_point().waits_no_more();
    }
}

impl<'a, T, D: Direction<T>> Future for Operation<'a, T, D> {
    type Output = Result<D::Success<'a>, D::Failure>;

    #[inline(always)]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.in_place();
        if this.phase == Phase::New
            && D::PLAIN
            && this.node().direction.is_open()
            && let Some(turn) = PlainTurn::of(cx)
        {
            let channel = this.channel();
            // SAFETY: a new send's node holds its value, a new receive's none, and no other thread
            // knows it. The future is pinned, and its drop withdraws it.
            let met = unsafe { channel.meet_fast(D::SEND, this.waiter(), turn) };
            // One after the other: a jump table costs more than two compares.
            if met == FastPath::Done {
                return Poll::Ready(Ok(this.done()));
            }
            if met == FastPath::Waits {
                this.phase = Phase::Listed;
                return Poll::Pending;
            }
            cold_path();
            return this.poll_after_prologue(met, turn, cx);
        }
        if this.phase == Phase::Listed && D::PLAIN_WHEN_MET && this.outcome() == Outcome::Done {
            this.waits_no_more();
            return Poll::Ready(Ok(this.done()));
        }
        cold_path();
        this.poll_slow_path(cx)
    }
}

impl<'a, T, D: Direction<T>> Drop for Operation<'a, T, D> {
    #[inline(always)]
    fn drop(&mut self) {
        if self.phase != Phase::Over {
            cold_path();
            self.drop_unfinished();
        }
    }
}

impl<'a, T, D: Direction<T>> Operation<'a, T, D> {
    #[inline(never)]
    fn drop_unfinished(&mut self) {
        // Dropped after the value.
        let _former;
        let outcome = match self.phase {
            Phase::Over => return,
            Phase::New => {
                replay::abandon(true);
                Outcome::Stale
            }
            Phase::GaveWay => Outcome::Done,
            // SAFETY: in this phase the node holds a value.
            Phase::Overwrote => return drop(unsafe { self.take_value() }),
            Phase::Listed | Phase::Logged | Phase::Settled(_) => {
                if self.phase == Phase::Logged {
                    replay::abandon(false);
                }
                let mut outcome = self.outcome();
                if matches!(outcome, Outcome::Waiting | Outcome::Held) {
                    (outcome, _former) = self.unlist();
                }
                outcome
            }
        };
        match outcome {
            Outcome::Broken => self.end.poison(),
            // SAFETY: it has this outcome, and was not over: its result was not taken.
            outcome => unsafe { D::dropped(self, outcome) },
        }
    }
}

luna_platform::debug_fields!(
    impl['a, T, D: Direction<T>] Operation<'a, T, D>, |operation|
    direction: D::NAME,
    phase: operation.phase
);
