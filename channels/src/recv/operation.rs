//! A receive under way.

use super::Receiver;
use crate::core::{Ending, FastPath, HandOff, Received, Taken};
use crate::error::{RecvError, RecvTimeoutError};
use crate::extended::{Mode, Noted, Plain};
use crate::hand_off_slots::Side;
use crate::replay::{self, GiveUp, Logged, Stage};
use crate::select_state::SelectState;
use crate::waiter::{Outcome, Waiter};
use luna_core::current::{self, PlainTurn, WakeHandle};
use luna_core::replay_log::{Event, Turn};
use luna_core::spin;
use std::cell::UnsafeCell;
use std::fmt;
use std::future::Future;
use std::hint::cold_path;
use std::marker::{PhantomData, PhantomPinned};
use std::pin::Pin;
use std::ptr::NonNull;
use std::task::{Context, Poll};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Phase {
    /// Not polled yet.
    New,
    /// The node is in the list, or has been settled.
    Listed,
    /// As `Listed`, and the next poll takes the slow path: a [replay log](crate::replay) is to see
    /// the outcome.
    Logged,
    /// Settled without having been listed: in an alternative; or failed, while the process lets
    /// others run.
    Settled(Outcome),
    /// Received; the node holds the value while the process lets others run.
    GaveWay,
    /// The outcome was returned.
    Over,
}

/// A receive under way: see [`Receiver::recv`]. `M` determines whether the sender is held.
///
/// # Invariants
///
/// The waiter holds a value in `GaveWay`, and in `Listed` and `Settled` if the outcome is `Done`.
/// In `Listed` it was begun, and is pinned.
///
/// What a plain receive touches lies together at its begin: the node ends with what is seldom used.
#[must_use = "an operation does nothing unless awaited or offered in an alternative"]
#[repr(C)]
pub struct RecvOp<'a, T, M: Mode = Plain> {
    pub(super) phase: Phase,
    /// Which extended rendezvous it was, in `Settled` and `GaveWay`.
    pub(super) ticket: u32,
    pub(super) receiver: &'a Receiver<T>,
    pub(super) noted: UnsafeCell<Noted<T, M::Note>>,
    pub(super) _pinned: PhantomPinned,
    pub(super) _mode: PhantomData<M>,
}

// SAFETY: a listed waiter is guarded by the channel's lock wherever the future is; the value passes
// between threads anyway.
unsafe impl<T: Send, M: Mode> Send for RecvOp<'_, T, M> {}
// SAFETY: `&RecvOp` gives access to nothing.
unsafe impl<T: Send, M: Mode> Sync for RecvOp<'_, T, M> {}

impl<'a, T, M: Mode> RecvOp<'a, T, M> {
    #[inline]
    pub(crate) fn new(receiver: &'a Receiver<T>) -> Self {
        RecvOp {
            receiver,
            noted: UnsafeCell::new(Noted {
                waiter: Waiter::empty(),
                note: M::Note::default(),
            }),
            phase: Phase::New,
            ticket: 0,
            _pinned: PhantomPinned,
            _mode: PhantomData,
        }
    }

    #[inline]
    pub(super) fn node(&self) -> NonNull<Waiter<T>> {
        // The waiter is the first field.
        // SAFETY: a cell's address is never null.
        unsafe { NonNull::new_unchecked(self.noted.get()) }.cast()
    }

    /// Not to be called while the node is listed: others change it then.
    #[inline]
    pub(super) fn waiter(&self) -> &Waiter<T> {
        // SAFETY: a node that is not listed, or was settled, is known to its future alone.
        unsafe { &(*self.noted.get()).waiter }
    }

    /// As for [`waiter`](Self::waiter).
    #[inline]
    pub(super) fn note(&mut self) -> &mut M::Note {
        &mut self.noted.get_mut().note
    }

    /// Takes one that waits, or is held, off its list: see
    /// [`Channel::withdraw`](crate::core::Channel::withdraw).
    #[must_use = "the handle's drop is user code, and the caller's last step"]
    fn take_back(&self) -> (Outcome, Option<WakeHandle>) {
        debug_assert!(self.is_listed());
        // SAFETY: the node was listed on the receivers' side: no other is waited with.
        unsafe { self.receiver.channel().withdraw(self.node(), false) }
    }

    /// The outcome of a receive that was listed or settled.
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
        M::waits(self.note());
        let node = self.node();
        // SAFETY: a new receive's node is known to its future alone.
        unsafe {
            Waiter::begin(node, M::HOLDS, select_state, None);
            if M::INHERITS {
                (*Waiter::link(node)).inherits = true;
            }
        }
        node
    }

    /// Number of the extended rendezvous that has ended.
    #[inline]
    pub(super) fn ticket(&self) -> u32 {
        match self.phase {
            // SAFETY: a settled node is known to its future alone, and was begun.
            Phase::Listed | Phase::Logged => unsafe { (*Waiter::link(self.node())).ticket },
            _ => self.ticket,
        }
    }

    /// What a settled receive returns.
    #[inline]
    pub(super) fn settled(&mut self, outcome: Outcome) -> Result<M::Received<'a, T>, RecvError> {
        let ticket = self.ticket();
        self.phase = Phase::Over;
        match outcome {
            Outcome::Done => {
                // SAFETY: a done receive holds its value, and no other thread knows the node any
                // more.
                let value = unsafe { self.waiter().take_value() };
                let note = std::mem::take(self.note());
                Ok(M::received(self.receiver, value, ticket, note))
            }
            Outcome::Poisoned => Err(RecvError::Poisoned),
            _ => Err(RecvError::Closed),
        }
    }

    /// What a plain receive returns whose node holds its value.
    #[inline(always)]
    fn done(&mut self) -> Poll<Result<M::Received<'a, T>, RecvError>> {
        self.phase = Phase::Over;
        // SAFETY: a done receive holds its value, and no other thread knows the node any more.
        let value = unsafe { self.waiter().take_value() };
        Poll::Ready(Ok(M::received(self.receiver, value, 0, M::Note::default())))
    }

    /// Keeps the received value in the node.
    #[inline]
    pub(super) fn keep(&mut self, value: T, ticket: u32) {
        // SAFETY: a receive that was not listed holds no value, and no other thread knows its node.
        unsafe { self.waiter().put_value(value) };
        self.ticket = ticket;
    }

    /// Withdraws: exact, since the outcome is looked at first.
    pub(super) fn give_up(self: Pin<&mut Self>) -> Result<M::Received<'a, T>, RecvTimeoutError> {
        // SAFETY: nothing is moved.
        let this = unsafe { self.get_unchecked_mut() };
        match this.phase {
            Phase::New | Phase::Over => Err(RecvTimeoutError::Timeout),
            Phase::GaveWay => this.settled(Outcome::Done).map_err(RecvTimeoutError::from),
            Phase::Settled(outcome) => this.settled(outcome).map_err(RecvTimeoutError::from),
            Phase::Listed | Phase::Logged => {
                let (outcome, _former) = this.take_back();
                match outcome {
                    Outcome::Waiting => {
                        this.phase = Phase::Over;
                        Err(RecvTimeoutError::Timeout)
                    }
                    outcome => this.settled(outcome).map_err(RecvTimeoutError::from),
                }
            }
        }
    }

    pub(super) fn poll_listed(
        &mut self,
        cx: &Context<'_>,
    ) -> Poll<Result<M::Received<'a, T>, RecvError>> {
        let mut outcome = self.outcome();
        let _former;
        if outcome == Outcome::Waiting {
            if current::branch_failed() {
                (outcome, _former) = self.take_back();
                if outcome == Outcome::Waiting {
                    current::stay_in_branch();
                    outcome = Outcome::Poisoned;
                }
            } else {
                // SAFETY: the node was listed.
                outcome = unsafe { self.receiver.channel().update_wake_handle(self.node(), cx) };
                if outcome == Outcome::Waiting {
                    return self.waits();
                }
            }
        }
        self.waits_no_more();
        Poll::Ready(self.settled(outcome))
    }

    /// It waits at its channel.
    #[inline(always)]
    fn waits<R>(&self) -> Poll<R> {
        self.receiver.channel().wait_point().waits();
        Poll::Pending
    }

    /// It is done, maybe in the turn in which it was to wait.
    #[inline(always)]
    fn waits_no_more(&self) {
        self.receiver.channel().wait_point().waits_no_more();
    }

    /// It fails without having waited, after others if it is their turn.
    #[cold]
    fn fails(
        &mut self,
        outcome: Outcome,
        cx: &Context<'_>,
    ) -> Poll<Result<M::Received<'a, T>, RecvError>> {
        if crate::fails_later(cx) {
            self.phase = Phase::Settled(outcome);
            return Poll::Pending;
        }
        Poll::Ready(self.settled(outcome))
    }

    /// Whether it waits for a partner, or has met a later one.
    fn is_listed(&self) -> bool {
        matches!(self.phase, Phase::Listed | Phase::Logged)
    }

    /// Meets what the fast path has found beside a plain partner.
    #[inline(never)]
    fn meet_other(&mut self, found: FastPath, turn: PlainTurn<'_>) -> FastPath {
        let channel = self.receiver.channel();
        // SAFETY: the fast path has just returned this for this receive, whose node is as new.
        unsafe {
            match found {
                FastPath::Store => channel.recv_stored(self.node(), turn),
                other => other,
            }
        }
    }

    /// Polls wherever the process is, and whatever is asked of the channel.
    #[inline(never)]
    fn poll_slow_path(
        &mut self,
        cx: &mut Context<'_>,
    ) -> Poll<Result<M::Received<'a, T>, RecvError>> {
        if replay::is_on() {
            return replay::poll(self, cx);
        }
        self.poll_under_lock(cx)
    }

    fn poll_under_lock(
        &mut self,
        cx: &mut Context<'_>,
    ) -> Poll<Result<M::Received<'a, T>, RecvError>> {
        let this = self;
        match this.phase {
            Phase::New => {}
            Phase::Listed | Phase::Logged => return this.poll_listed(cx),
            Phase::GaveWay => return Poll::Ready(this.settled(Outcome::Done)),
            Phase::Settled(outcome @ (Outcome::Poisoned | Outcome::Closed)) => {
                if current::branch_failed() {
                    current::stay_in_branch();
                }
                return Poll::Ready(this.settled(outcome));
            }
            Phase::Settled(_) | Phase::Over => panic!("a receive was polled after it was over"),
        }
        if current::branch_failed() {
            current::stay_in_branch();
            return this.fails(Outcome::Poisoned, cx);
        }
        let mut locked = if M::HOLDS || M::INHERITS {
            this.receiver.channel().lock()
        } else {
            // SAFETY: a new receive's node holds no value, and no other thread knows it. The future
            // is pinned, and it looks until the hand-off slot is left.
            match unsafe { this.receiver.channel().recv_by_slot(this.node()) } {
                HandOff::No(locked) => locked,
                HandOff::Done(value) => {
                    let taken = Taken::new(this.receiver.channel(), value, 0);
                    let gives_way = crate::gives_way(cx);
                    let value = taken.keep();
                    if gives_way {
                        this.keep(value, 0);
                        this.phase = Phase::GaveWay;
                        return Poll::Pending;
                    }
                    this.phase = Phase::Over;
                    let note = std::mem::take(this.note());
                    return Poll::Ready(Ok(M::received(this.receiver, value, 0, note)));
                }
                HandOff::Waits => {
                    this.phase = Phase::Listed;
                    // SAFETY: the node waits on the hand-off slot.
                    let outcome = unsafe {
                        let channel = this.receiver.channel();
                        channel.look_from_slot(this.node(), Side::Receiver, cx)
                    };
                    return match outcome {
                        Outcome::Waiting => this.waits(),
                        outcome => Poll::Ready(this.settled(outcome)),
                    };
                }
            }
        };
        if M::INHERITS {
            locked.note_server();
        }
        match locked.recv_now(M::HOLDS) {
            Received::Done(value, ready, holding) => {
                if M::INHERITS {
                    // Under the lock and in this order: a server that is between the two would not
                    // be as urgent as its client.
                    M::holds(this.note(), holding.priority);
                    locked.boost_while_they_wait();
                }
                drop(locked);
                let ticket = holding.ticket;
                let taken = Taken::new(this.receiver.channel(), value, ticket);
                ready.wake();
                let completes_later = crate::completes_later(cx);
                let value = taken.keep();
                if completes_later {
                    this.keep(value, ticket);
                    this.phase = Phase::GaveWay;
                    return Poll::Pending;
                }
                this.phase = Phase::Over;
                let note = std::mem::take(this.note());
                Poll::Ready(Ok(M::received(this.receiver, value, ticket, note)))
            }
            Received::Empty => {
                let looks = spin::may_look();
                // A waker is not cloned under the lock, but brought when it is released.
                let wake_handle = match looks {
                    true => None,
                    false => WakeHandle::without_waker(cx),
                };
                let has_wake_handle = wake_handle.is_some();
                // SAFETY: the future is pinned, and its drop withdraws the node.
                unsafe {
                    let node = this.begin(None);
                    locked.list_receiver(node, current::priority(), wake_handle);
                }
                this.phase = Phase::Listed;
                drop(locked);
                if has_wake_handle {
                    return this.waits();
                }
                let channel = this.receiver.channel();
                // SAFETY: the node was listed.
                match unsafe { channel.look_for_partner(this.node(), looks, cx) } {
                    Outcome::Waiting => this.waits(),
                    outcome => Poll::Ready(this.settled(outcome)),
                }
            }
            Received::Ended(ending) => {
                drop(locked);
                let outcome = match ending {
                    Ending::Poisoned => Outcome::Poisoned,
                    _ => Outcome::Closed,
                };
                this.fails(outcome, cx)
            }
            Received::Broken(ready) => {
                drop(locked);
                this.phase = Phase::Over;
                this.receiver.poison();
                ready.wake();
                this.fails(Outcome::Poisoned, cx)
            }
        }
    }
}

impl<'a, T, M: Mode> Future for RecvOp<'a, T, M> {
    type Output = Result<M::Received<'a, T>, RecvError>;

    #[inline(always)]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: nothing pinned is moved: a listed node stays in its place.
        let this = unsafe { self.get_unchecked_mut() };
        if this.phase == Phase::New
            && !M::HOLDS
            && !M::INHERITS
            && let Some(turn) = PlainTurn::of(cx)
        {
            let channel = this.receiver.channel();
            // SAFETY: a new receive's node holds no value, and no other thread knows it. The future
            // is pinned, and its drop withdraws it.
            let mut fast_path = unsafe { channel.recv_fast(this.node(), turn) };
            // As for a send: the two usual ways first.
            if !matches!(fast_path, FastPath::Done | FastPath::Waits) {
                cold_path();
                fast_path = this.meet_other(fast_path, turn);
            }
            match fast_path {
                FastPath::Done => return this.done(),
                FastPath::Waits => this.phase = Phase::Listed,
                FastPath::GaveWay => this.phase = Phase::GaveWay,
                _ => return this.poll_slow_path(cx),
            }
            return Poll::Pending;
        }
        if this.phase == Phase::Listed
            && !M::HOLDS
            && !M::INHERITS
            && this.outcome() == Outcome::Done
        {
            this.waits_no_more();
            return this.done();
        }
        cold_path();
        this.poll_slow_path(cx)
    }
}

impl<T, M: Mode> Drop for RecvOp<'_, T, M> {
    #[inline(always)]
    fn drop(&mut self) {
        if self.phase != Phase::Over {
            cold_path();
            self.drop_unfinished();
        }
    }
}

impl<T, M: Mode> RecvOp<'_, T, M> {
    #[inline(never)]
    fn drop_unfinished(&mut self) {
        let _former;
        let holds_value = match self.phase {
            Phase::New => {
                replay::abandon(true);
                false
            }
            Phase::Over => false,
            Phase::GaveWay => true,
            Phase::Listed | Phase::Logged | Phase::Settled(_) => {
                if self.phase == Phase::Logged {
                    replay::abandon(false);
                }
                let mut outcome = self.outcome();
                if outcome == Outcome::Waiting {
                    (outcome, _former) = self.take_back();
                }
                outcome == Outcome::Done
            }
        };
        if holds_value {
            // SAFETY: the value is here, and no other thread knows the node any more.
            let value = unsafe { self.waiter().take_value() };
            let ticket = self.ticket();
            M::give_back(self.receiver, value, ticket);
        }
    }
}

impl<'a, T, M: Mode> Logged for RecvOp<'a, T, M> {
    type Output = Result<M::Received<'a, T>, RecvError>;

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
            Phase::Settled(_) | Phase::Over => Stage::Over,
        }
    }

    fn come(&mut self, _: Turn, _: &mut Context<'_>) -> Poll<()> {
        self.receiver.channel().note_logged(false);
        // SAFETY: a new receive's node is known to its future alone.
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
        self.phase = Phase::Over;
        Poll::Ready(Err(match number {
            replay::failure::POISONED => RecvError::Poisoned,
            _ => RecvError::Closed,
        }))
    }

    fn failure(output: &<Self as Logged>::Output) -> Option<Event> {
        let error = output.as_ref().err()?;
        Some(replay::ended(*error == RecvError::Poisoned))
    }
}

impl<'a, T, M: Mode> GiveUp for RecvOp<'a, T, M> {
    type Outcome = Result<M::Received<'a, T>, RecvTimeoutError>;

    fn lets_others_run(&self) -> bool {
        matches!(self.phase, Phase::GaveWay | Phase::Settled(_))
    }

    fn give_up(self: Pin<&mut Self>) -> Self::Outcome {
        self.give_up()
    }

    fn in_time(output: <Self as Logged>::Output) -> Self::Outcome {
        output.map_err(RecvTimeoutError::from)
    }

    fn failure_in_time(outcome: &Self::Outcome) -> Option<Event> {
        Some(match outcome.as_ref().err()? {
            RecvTimeoutError::Timeout => replay::gave_up(),
            error => replay::ended(*error == RecvTimeoutError::Poisoned),
        })
    }
}

impl<T, M: Mode> fmt::Debug for RecvOp<'_, T, M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RecvOp")
            .field("phase", &self.phase)
            .finish_non_exhaustive()
    }
}
