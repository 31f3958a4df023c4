//! A send under way.

use super::Sender;
use crate::core::{Ending, FastPath, HandOff, Sent};
use crate::error::{SendError, SendTimeoutError};
use crate::hand_off_slots::Side;
use crate::replay::{self, GiveUp, Logged, Stage};
use crate::select_state::SelectState;
use crate::source::{InNode, Offered, Source};
use crate::waiter::{Outcome, Waiter};
use luna_core::current::{self, PlainTurn, WakeHandle};
use luna_core::replay_log::{Event, Turn};
use luna_core::spin;
use std::cell::UnsafeCell;
use std::fmt;
use std::future::Future;
use std::hint::cold_path;
use std::marker::PhantomPinned;
use std::mem::MaybeUninit;
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Phase {
    /// Not polled yet; the node holds the value.
    New,
    /// The node is in the list, or has been settled.
    Listed,
    /// As `Listed`, and the next poll takes the slow path: a [replay log](crate::replay) is to see
    /// the outcome.
    Logged,
    /// Settled without having been listed: in an alternative; or failed, while the process lets
    /// others run.
    Settled(Outcome),
    /// Settled as done in an alternative, and the node holds the value that a full buffer dropped
    /// for it.
    Overwrote,
    /// Sent; the process lets others run before it continues.
    GaveWay,
    /// The outcome was returned.
    Over,
}

/// A send under way: see [`Sender::send`]. `S` is the source of its value.
///
/// # Invariants
///
/// The waiter holds the value, or can make it, in `New`, and in `Listed` and `Settled` unless the
/// outcome is `Done`, `Held` or `Broken`; the answer if it is `Answered`. In `Listed` it was begun,
/// and is pinned.
///
/// What a plain send touches lies together at its begin: the node ends with what is seldom used.
#[must_use = "an operation does nothing unless awaited or offered in an alternative"]
#[repr(C)]
pub struct SendOp<'a, T, S: Source<T> = InNode> {
    pub(super) phase: Phase,
    pub(super) sender: &'a Sender<T>,
    pub(super) offered: UnsafeCell<Offered<T, S>>,
    pub(super) _pinned: PhantomPinned,
}

// SAFETY: a listed waiter is guarded by the channel's lock wherever the future is; the value, and
// what makes it, pass between threads anyway.
unsafe impl<T: Send, S: Source<T> + Send> Send for SendOp<'_, T, S> {}
// SAFETY: `&SendOp` gives access to nothing.
unsafe impl<T: Send, S: Source<T> + Send> Sync for SendOp<'_, T, S> {}

impl<'a, T> SendOp<'a, T> {
    /// A send of `value`, which is written where it is to lie: to make the node first and move it
    /// would be to copy also what is not written before it is listed.
    #[inline(always)]
    pub(super) fn of_value(sender: &'a Sender<T>, value: T) -> Self {
        let mut send = MaybeUninit::<Self>::uninit();
        let place = send.as_mut_ptr();
        // SAFETY: the memory is this function's. Fields left unwritten may stay so: the node of a
        // send that is not listed.
        unsafe {
            (&raw mut (*place).sender).write(sender);
            let offered = UnsafeCell::raw_get(&raw const (*place).offered);
            Waiter::write_value(&raw mut (*offered).waiter, value);
            (&raw mut (*place).phase).write(Phase::New);
            send.assume_init()
        }
    }
}

impl<'a, T, S: Source<T>> SendOp<'a, T, S> {
    #[inline]
    pub(crate) fn new(sender: &'a Sender<T>, offered: Offered<T, S>) -> Self {
        SendOp {
            sender,
            offered: UnsafeCell::new(offered),
            phase: Phase::New,
            _pinned: PhantomPinned,
        }
    }

    #[inline]
    pub(super) fn offer_pointer(&self) -> NonNull<Offered<T, S>> {
        // SAFETY: a cell's address is never null.
        unsafe { NonNull::new_unchecked(self.offered.get()) }
    }

    #[inline]
    pub(super) fn node(&self) -> NonNull<Waiter<T>> {
        // The waiter is the first field.
        self.offer_pointer().cast()
    }

    /// Not to be called while the node is listed: others change it then.
    #[inline]
    pub(super) fn offered(&mut self) -> &mut Offered<T, S> {
        // A node that is not listed, or was settled, is known to its future alone.
        self.offered.get_mut()
    }

    /// Takes one that waits, or is held, off its list: see
    /// [`Channel::withdraw`](crate::core::Channel::withdraw).
    #[must_use = "the handle's drop is user code, and the caller's last step"]
    fn take_back(&self) -> (Outcome, Option<WakeHandle>) {
        debug_assert!(self.is_listed());
        // SAFETY: the node was listed on the senders' side: no other is waited with.
        unsafe { self.sender.channel().withdraw(self.node(), true) }
    }

    /// The outcome of a send that was listed or settled.
    #[inline]
    pub(super) fn outcome(&self) -> Outcome {
        match self.phase {
            Phase::Settled(outcome) => outcome,
            // SAFETY: the node lies in this future, and was begun before it was listed.
            _ => unsafe { Waiter::outcome(self.node()) },
        }
    }

    /// Prepares the node for being listed.
    #[inline]
    pub(super) fn begin(
        &mut self,
        select_state: Option<(NonNull<SelectState>, u32)>,
    ) -> NonNull<Waiter<T>> {
        // SAFETY: a new send's node is known to its future alone.
        unsafe { Waiter::begin(self.node(), false, select_state, S::MAKE) };
        self.node()
    }

    pub(super) fn failed(&mut self, ending: Outcome) -> SendError<S::Unsent> {
        self.phase = Phase::Over;
        SendError {
            // SAFETY: the send failed, so the value is still here, and no other thread knows the
            // node any more.
            value: unsafe { S::unsent(self.offered()) },
            poisoned: ending == Outcome::Poisoned,
        }
    }

    /// What a settled send returns.
    pub(super) fn settled(&mut self, outcome: Outcome) -> Result<(), SendError<S::Unsent>> {
        match outcome {
            Outcome::Done | Outcome::Held => {
                self.phase = Phase::Over;
                Ok(())
            }
            Outcome::Answered => {
                self.phase = Phase::Settled(outcome);
                Ok(())
            }
            Outcome::Broken => self.broken(),
            outcome => Err(self.failed(outcome)),
        }
    }

    /// The closure that was to make the value has panicked, here or on the receiver's side.
    #[cold]
    pub(super) fn broken(&mut self) -> ! {
        self.phase = Phase::Over;
        self.sender.poison();
        panic!("the closure of a `send_with` panicked: its channel is poisoned")
    }

    /// The value given back to a successful send, if any.
    pub(crate) fn take_answer(self: Pin<&mut Self>) -> Option<T> {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        let is_answered = this.phase == Phase::Settled(Outcome::Answered);
        is_answered.then(|| {
            this.phase = Phase::Over;
            // SAFETY: an answered node holds a value, and no other thread knows it.
            unsafe { this.offered().waiter.take_value() }
        })
    }

    /// Waits no longer: it fails as poisoned if its value was not taken, and is done if it was. The
    /// [output](Guard::output) says which.
    pub(crate) fn abandon(self: Pin<&mut Self>) {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        if matches!(this.phase, Phase::Listed | Phase::Logged) {
            let (outcome, _former) = this.take_back();
            if outcome == Outcome::Waiting {
                this.phase = Phase::Settled(Outcome::Poisoned);
            }
        }
    }

    /// Withdraws a value that was not taken: exact, since the outcome is looked at first.
    pub(super) fn give_up(self: Pin<&mut Self>) -> Result<(), SendTimeoutError<S::Unsent>> {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        match this.phase {
            Phase::New => Err(SendTimeoutError::Timeout(
                this.failed(Outcome::Closed).value,
            )),
            Phase::GaveWay | Phase::Over | Phase::Overwrote => Ok(()),
            Phase::Settled(outcome) => this.settled(outcome).map_err(SendTimeoutError::from),
            Phase::Listed | Phase::Logged => {
                let (outcome, _former) = this.take_back();
                match outcome {
                    Outcome::Waiting => Err(SendTimeoutError::Timeout(
                        this.failed(Outcome::Closed).value,
                    )),
                    outcome => this.settled(outcome).map_err(SendTimeoutError::from),
                }
            }
        }
    }

    pub(super) fn poll_listed(
        &mut self,
        cx: &Context<'_>,
    ) -> Poll<Result<(), SendError<S::Unsent>>> {
        let mut outcome = self.outcome();
        let _former;
        if matches!(outcome, Outcome::Waiting | Outcome::Held) {
            // A held sender has communicated: no failure takes that back.
            if outcome == Outcome::Waiting && current::branch_failed() {
                (outcome, _former) = self.take_back();
                if outcome == Outcome::Waiting {
                    current::stay_in_branch();
                    return Poll::Ready(Err(self.failed(Outcome::Poisoned)));
                }
            } else {
                // SAFETY: the node was listed.
                outcome = unsafe { self.sender.channel().update_wake_handle(self.node(), cx) };
                if matches!(outcome, Outcome::Waiting | Outcome::Held) {
                    return self.waits();
                }
            }
        }
        self.waits_no_more();
        Poll::Ready(self.settled(outcome))
    }

    /// It is done, and others may be let run first.
    #[inline]
    fn sent(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), SendError<S::Unsent>>> {
        // Before the user's code (a waker) can panic: the value is gone.
        self.phase = Phase::Over;
        if crate::completes_later(cx) {
            self.phase = Phase::GaveWay;
            return Poll::Pending;
        }
        Poll::Ready(Ok(()))
    }

    /// What was seen by looking for the partner.
    #[inline]
    fn looked(
        &mut self,
        outcome: Outcome,
        cx: &Context<'_>,
    ) -> Poll<Result<(), SendError<S::Unsent>>> {
        match outcome {
            Outcome::Waiting => self.waits(),
            // Its receiver has the value, and is not done with it: that may take long.
            Outcome::Held => self.poll_listed(cx),
            outcome => Poll::Ready(self.settled(outcome)),
        }
    }

    /// It waits at its channel.
    #[inline(always)]
    fn waits<R>(&self) -> Poll<R> {
        self.sender.channel().wait_point().waits();
        Poll::Pending
    }

    /// It is done, maybe in the turn in which it was to wait.
    #[inline(always)]
    fn waits_no_more(&self) {
        self.sender.channel().wait_point().waits_no_more();
    }

    /// It fails without having waited, after others if it is their turn.
    #[cold]
    fn fails(
        &mut self,
        outcome: Outcome,
        cx: &Context<'_>,
    ) -> Poll<Result<(), SendError<S::Unsent>>> {
        if crate::fails_later(cx) {
            self.phase = Phase::Settled(outcome);
            return Poll::Pending;
        }
        Poll::Ready(Err(self.failed(outcome)))
    }

    /// Whether it is over but for letting others run.
    pub(crate) fn lets_others_run(&self) -> bool {
        matches!(self.phase, Phase::GaveWay | Phase::Settled(_))
    }

    /// Whether it waits for a partner, or has met a later one.
    fn is_listed(&self) -> bool {
        matches!(self.phase, Phase::Listed | Phase::Logged)
    }

    /// Meets what the fast path has found beside a plain partner.
    #[inline(never)]
    fn meet_other(&mut self, found: FastPath, turn: PlainTurn<'_>) -> FastPath {
        let channel = self.sender.channel();
        // SAFETY: the fast path has just returned this for this send, whose node is as new.
        unsafe {
            match found {
                FastPath::Store => channel.store_fast(self.node(), turn),
                FastPath::More => channel.send_to_more(self.offer_pointer()),
                other => other,
            }
        }
    }

    /// Polls wherever the process is, and whatever is asked of the channel.
    #[inline(never)]
    fn poll_slow_path(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), SendError<S::Unsent>>> {
        if replay::is_on() {
            return replay::poll(self, cx);
        }
        self.poll_under_lock(cx)
    }

    fn poll_under_lock(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), SendError<S::Unsent>>> {
        let this = self;
        match this.phase {
            Phase::New => {}
            Phase::Listed | Phase::Logged => return this.poll_listed(cx),
            Phase::GaveWay => {
                this.phase = Phase::Over;
                return Poll::Ready(Ok(()));
            }
            Phase::Settled(outcome @ (Outcome::Poisoned | Outcome::Closed)) => {
                if current::branch_failed() {
                    current::stay_in_branch();
                }
                return Poll::Ready(Err(this.failed(outcome)));
            }
            Phase::Overwrote | Phase::Settled(_) | Phase::Over => {
                panic!("a send was polled after it was over")
            }
        }
        if current::branch_failed() {
            current::stay_in_branch();
            return this.fails(Outcome::Poisoned, cx);
        }
        if !this.offered().source.is_open() {
            return Poll::Pending;
        }
        // SAFETY: a new send's node holds or can make its value, and no other thread knows it. The
        // future is pinned, and it looks until the hand-off slot is left.
        let mut locked = match unsafe { this.sender.channel().send_by_slot(this.offer_pointer()) } {
            HandOff::No(locked) => locked,
            HandOff::Done(()) => return this.sent(cx),
            HandOff::Waits => {
                this.phase = Phase::Listed;
                // SAFETY: the node waits on the hand-off slot.
                let outcome = unsafe {
                    let channel = this.sender.channel();
                    channel.look_from_slot(this.node(), Side::Sender, cx)
                };
                return this.looked(outcome, cx);
            }
        };
        // SAFETY: a new send's node holds or can make its value, and no other thread knows it. The
        // future is pinned, and its drop withdraws it.
        let sent = unsafe { locked.send_now(this.offer_pointer(), Some(cx)) };
        match sent {
            Sent::Done(ready, dropped) => {
                // Before the user's code below (a waker, a drop) can panic: the value is gone.
                this.phase = Phase::Over;
                locked.release();
                ready.wake();
                drop(dropped);
                this.sent(cx)
            }
            Sent::Full => {
                let looks = spin::may_look();
                // A waker is not cloned under the lock, but brought when it is released.
                let wake_handle = match looks {
                    true => None,
                    false => WakeHandle::without_waker(cx),
                };
                let has_wake_handle = wake_handle.is_some();
                // SAFETY: the node still holds or can make its value; the future is pinned, and its
                // drop withdraws the node.
                unsafe {
                    let node = this.begin(None);
                    locked.list_sender(node, current::priority(), wake_handle);
                }
                this.phase = Phase::Listed;
                locked.release();
                if has_wake_handle {
                    return this.waits();
                }
                let channel = this.sender.channel();
                // SAFETY: the node was listed.
                let outcome = unsafe { channel.look_for_partner(this.node(), looks, cx) };
                this.looked(outcome, cx)
            }
            Sent::Held(ready) => {
                this.phase = Phase::Listed;
                locked.release();
                ready.wake();
                this.poll_listed(cx)
            }
            Sent::Ended(ending) => {
                locked.release();
                let outcome = match ending {
                    Ending::Poisoned => Outcome::Poisoned,
                    _ => Outcome::Closed,
                };
                this.fails(outcome, cx)
            }
            Sent::Broken(ready) => {
                this.phase = Phase::Over;
                locked.release();
                ready.wake();
                this.broken()
            }
        }
    }
}

impl<T, S: Source<T>> Future for SendOp<'_, T, S> {
    type Output = Result<(), SendError<S::Unsent>>;

    #[inline(always)]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: nothing pinned is moved: a listed node stays in its place.
        let this = unsafe { self.get_unchecked_mut() };
        if this.phase == Phase::New
            && S::MAKE.is_none()
            && this.offered().source.is_open()
            && let Some(turn) = PlainTurn::of(cx)
        {
            let channel = this.sender.channel();
            // SAFETY: a new send's node holds its value, and no other thread knows it. The future
            // is pinned, and its drop withdraws it.
            let mut fast_path = unsafe { channel.send_fast(this.node(), turn) };
            // The two usual ways first: with more the compiler jumps by a table, which a processor
            // that has done something else meanwhile cannot foresee.
            if !matches!(fast_path, FastPath::Done | FastPath::Waits) {
                cold_path();
                fast_path = this.meet_other(fast_path, turn);
            }
            match fast_path {
                FastPath::Done => {
                    this.phase = Phase::Over;
                    return Poll::Ready(Ok(()));
                }
                FastPath::Waits => this.phase = Phase::Listed,
                FastPath::GaveWay => this.phase = Phase::GaveWay,
                _ => return this.poll_slow_path(cx),
            }
            return Poll::Pending;
        }
        if this.phase == Phase::Listed && this.outcome() == Outcome::Done {
            this.waits_no_more();
            this.phase = Phase::Over;
            return Poll::Ready(Ok(()));
        }
        cold_path();
        this.poll_slow_path(cx)
    }
}

impl<T, S: Source<T>> Drop for SendOp<'_, T, S> {
    #[inline(always)]
    fn drop(&mut self) {
        if self.phase != Phase::Over {
            cold_path();
            self.drop_unfinished();
        }
    }
}

impl<T, S: Source<T>> SendOp<'_, T, S> {
    #[inline(never)]
    fn drop_unfinished(&mut self) {
        // Dropped after the value.
        let _former;
        match self.phase {
            Phase::GaveWay | Phase::Over => return,
            Phase::New => replay::abandon(true),
            // SAFETY: in this phase the node holds a value.
            Phase::Overwrote => return drop(unsafe { self.offered().waiter.take_value() }),
            Phase::Listed | Phase::Logged | Phase::Settled(_) => {
                if self.phase == Phase::Logged {
                    replay::abandon(false);
                }
                let mut outcome = self.outcome();
                if matches!(outcome, Outcome::Waiting | Outcome::Held) {
                    (outcome, _former) = self.take_back();
                }
                match outcome {
                    Outcome::Done | Outcome::Held => return,
                    Outcome::Broken => return self.sender.poison(),
                    _ => {}
                }
            }
        }
        // SAFETY: the value is still here, and no other thread knows the node any more.
        drop(unsafe { S::unsent(self.offered()) });
    }
}

impl<T, S: Source<T>> Logged for SendOp<'_, T, S> {
    type Output = Result<(), SendError<S::Unsent>>;

    fn stage(&self) -> Stage {
        match self.phase {
            Phase::New => Stage::New,
            Phase::Listed => Stage::Elsewhere,
            Phase::Logged if self.outcome() == Outcome::Done => Stage::Met,
            Phase::Logged => Stage::Waits,
            Phase::GaveWay => Stage::GaveWay,
            Phase::Settled(outcome @ (Outcome::Poisoned | Outcome::Closed)) => {
                Stage::Failed(replay::ended(outcome == Outcome::Poisoned))
            }
            Phase::Settled(_) | Phase::Overwrote | Phase::Over => Stage::Over,
        }
    }

    fn come(&mut self, _: Turn, _: &mut Context<'_>) -> Poll<()> {
        self.sender.channel().note_logged(true);
        // SAFETY: a new send's node is known to its future alone.
        unsafe { Waiter::clear_order(self.node()) };
        Poll::Ready(())
    }

    fn poll_unlogged(&mut self, cx: &mut Context<'_>) -> Poll<<Self as Logged>::Output> {
        self.poll_under_lock(cx)
    }

    fn wait_logged(&mut self) {
        self.phase = Phase::Logged;
    }

    unsafe fn success(&self, _: Option<&<Self as Logged>::Output>, own: u64) -> Event {
        // SAFETY: the contract.
        let of_partner = unsafe { Waiter::order(self.node()) };
        Event::done(replay::stamp(of_partner, own))
    }

    fn fail(&mut self, number: u64) -> Poll<<Self as Logged>::Output> {
        Poll::Ready(Err(self.failed(match number {
            replay::failure::POISONED => Outcome::Poisoned,
            _ => Outcome::Closed,
        })))
    }

    fn failure(output: &<Self as Logged>::Output) -> Option<Event> {
        let error = output.as_ref().err()?;
        Some(replay::ended(error.poisoned))
    }

    /// It was sent before the receivers went, but never received.
    fn closed_later(&self) -> Option<<Self as Logged>::Output> {
        Some(Ok(()))
    }
}

impl<T> GiveUp for SendOp<'_, T> {
    type Outcome = Result<(), SendTimeoutError<T>>;

    fn lets_others_run(&self) -> bool {
        self.lets_others_run()
    }

    fn give_up(self: Pin<&mut Self>) -> Self::Outcome {
        self.give_up()
    }

    fn in_time(output: <Self as Logged>::Output) -> Self::Outcome {
        output.map_err(SendTimeoutError::from)
    }

    fn failure_in_time(outcome: &Self::Outcome) -> Option<Event> {
        Some(match outcome.as_ref().err()? {
            SendTimeoutError::Timeout(_) => replay::gave_up(),
            error => replay::ended(matches!(error, SendTimeoutError::Poisoned(_))),
        })
    }
}

impl<T, S: Source<T>> fmt::Debug for SendOp<'_, T, S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SendOp")
            .field("phase", &self.phase)
            .finish_non_exhaustive()
    }
}
