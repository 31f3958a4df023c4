//! An operation under the lock of its channel: wherever the process is, and whatever is asked of
//! the channel.

use super::{Direction, GivesUp, Operation, Phase};
use crate::core::{Attempted, ChannelGuard, Ending, FastPath, HandOff};
use crate::replay;
use crate::wait_point::Lists;
use crate::waiter::{Outcome, Waiter, Waits};
use core::future::Future;
use core::task::{Context, Poll};
use luna_core::current::{self, Here, PlainTurn, Renewal, WakeHandle};
use luna_core::spin;

/// The result of polling an operation.
type Polled<O> = Poll<<O as Future>::Output>;

impl<'a, T, D: Direction<T>> Operation<'a, T, D> {
    #[inline(never)]
    pub(super) fn poll_slow_path(&mut self, cx: &mut Context<'_>) -> Polled<Self> {
        replay::poll(self, cx)
    }

    pub(super) fn poll_new(&mut self, cx: &mut Context<'_>) -> Polled<Self> {
        if current::branch_failed() {
            current::stay_in_branch();
            return self.fails(Outcome::Poisoned, cx);
        }
        if !self.node().direction.is_open() {
            return Poll::Pending;
        }
        let (channel, here) = (self.channel(), Here::now());
        let mut locked = channel.lock_beside_slots(here);
        if D::PLAIN {
            // SAFETY: by the invariants a new send's node holds its value, a new receive's none,
            // and no other thread knows it. The future is pinned, and it looks until the hand-off
            // slot is left.
            match unsafe { locked.meet_at_slot(D::SEND, self.waiter()) } {
                HandOff::No => {}
                HandOff::Done => {
                    drop(locked);
                    self.phase = Phase::Settled(Outcome::Done);
                    return self.done_in_turn(cx);
                }
                HandOff::Waits => {
                    drop(locked);
                    self.phase = Phase::Listed;
                    // SAFETY: the node waits on the hand-off slot.
                    let outcome = unsafe { channel.look_from_slot(self.waiter(), D::SEND, cx) };
                    return self.looked(outcome, cx);
                }
            }
        } else {
            locked.list_from_slots();
        }
        self.go_on(locked, None, cx)
    }

    /// What the [prologue](crate::core::Channel::meet_fast) has not completed.
    #[cold]
    #[inline(never)]
    pub(super) fn poll_after_prologue(
        &mut self,
        met: FastPath,
        turn: PlainTurn<'_>,
        cx: &mut Context<'_>,
    ) -> Polled<Self> {
        match met {
            FastPath::Inside => self.go_on_inside(turn, cx),
            FastPath::No => self.poll_new(cx),
            FastPath::Done | FastPath::Waits | FastPath::GaveWay => {
                self.phase = Phase::GaveWay;
                Poll::Pending
            }
        }
    }

    /// Goes on under the lock that the prologue has taken.
    fn go_on_inside(&mut self, turn: PlainTurn<'_>, cx: &mut Context<'_>) -> Polled<Self> {
        let channel = self.channel();
        // SAFETY: the prologue has kept the lock of this channel in this poll, and this is called
        // once for it.
        let mut locked = unsafe { channel.guard_of(channel.wait_point().kept(turn), turn.here()) };
        locked.lists.list_lone();
        self.go_on(locked, Some(turn), cx)
    }

    /// The protocol of an operation that is new, under the lock of its channel, however that is
    /// held: meets what waits, or waits itself.
    #[inline(always)]
    fn go_on<L: Lists>(
        &mut self,
        mut locked: ChannelGuard<'_, T, L>,
        plain: Option<PlainTurn<'_>>,
        cx: &mut Context<'_>,
    ) -> Polled<Self> {
        let here = locked.here();
        // SAFETY: it is new; the future is pinned, and its drop withdraws it.
        match unsafe { D::attempt(self.node_pointer(), &mut locked, Some(cx)) } {
            Attempted::NotNow => {
                let looks = plain.is_none() && spin::may_look();
                let mut has_wake_handle = true;
                // SAFETY: it is still new, since it could not happen. The future is pinned, and its
                // drop withdraws it.
                unsafe {
                    match plain {
                        Some(turn) => Waiter::begin_plain(self.waiter(), turn),
                        None => {
                            // A waker is not cloned under the lock, but brought when it is
                            // released.
                            let wake_handle = match looks {
                                true => None,
                                false => WakeHandle::without_waker(cx),
                            };
                            has_wake_handle = wake_handle.is_some();
                            let wait = (here, wake_handle).into_node();
                            self.begin(wait, None);
                        }
                    }
                    locked.list(D::SEND, self.waiter());
                }
                self.phase = Phase::Listed;
                Self::release(locked);
                if has_wake_handle {
                    return self.waits();
                }
                let outcome = match looks && spin::look(|| self.outcome() != Outcome::Waiting) {
                    true => self.outcome(),
                    // SAFETY: the node was listed. A partner comes before this, and has settled the
                    // node, or finds the wake handle.
                    false => unsafe { self.renew_wake_handle(Renewal::made(cx)) },
                };
                self.looked(outcome, cx)
            }
            Attempted::Held(ready) => {
                self.phase = Phase::Listed;
                Self::release(locked);
                ready.wake();
                self.poll_listed(cx)
            }
            Attempted::Ended(ending) => {
                Self::release(locked);
                self.fails(Outcome::of(ending), cx)
            }
            met => {
                let ready = self.met(met);
                Self::release(locked);
                ready.wake();
                self.done_in_turn(cx)
            }
        }
    }

    /// Releases the lock. Only a send can have something to report to registered alternatives.
    #[inline(always)]
    fn release<L: Lists>(locked: ChannelGuard<'_, T, L>) {
        match D::SEND {
            true => locked.release(),
            false => drop(locked),
        }
    }

    /// Notes what came of an attempt, and returns the process to wake without the lock.
    ///
    /// To be called under the lock: after it the user's code (a waker, a drop) may panic, and the
    /// operation's drop takes over.
    pub(super) fn met(&mut self, attempted: Attempted) -> current::PendingWake {
        self.note(&attempted);
        attempted.into_wake()
    }

    fn note(&mut self, attempted: &Attempted) {
        self.phase = match attempted {
            Attempted::Done(_) => Phase::Settled(Outcome::Done),
            Attempted::Overwrote(_) => Phase::Overwrote,
            Attempted::Held(_) => Phase::Listed,
            Attempted::Broken(_) => Phase::Settled(Outcome::Broken),
            Attempted::Ended(ending) => Phase::Settled(Outcome::of(*ending)),
            Attempted::NotNow | Attempted::Holds(_) => self.phase,
        };
    }

    /// Drops what a full buffer has dropped for a send. The user's code: no lock is held.
    pub(super) fn drop_overwritten(&mut self) {
        if self.phase == Phase::Overwrote {
            self.phase = Phase::Settled(Outcome::Done);
            // SAFETY: in this phase the node holds it.
            drop(unsafe { self.take_value() });
        }
    }

    /// It is done without having waited, after others if it is their turn.
    fn done_in_turn(&mut self, cx: &mut Context<'_>) -> Polled<Self> {
        self.drop_overwritten();
        if self.phase == Phase::Settled(Outcome::Done) && crate::completes_later(cx) {
            self.phase = Phase::GaveWay;
            return Poll::Pending;
        }
        let outcome = self.outcome();
        Poll::Ready(self.settled(outcome))
    }

    /// It fails without having waited, after others if it is their turn.
    #[cold]
    fn fails(&mut self, outcome: Outcome, cx: &mut Context<'_>) -> Polled<Self> {
        if crate::fails_later(cx) {
            self.phase = Phase::Settled(outcome);
            return Poll::Pending;
        }
        Poll::Ready(self.settled(outcome))
    }

    /// # Safety
    ///
    /// The node was listed, and was not withdrawn.
    pub(super) unsafe fn renew_wake_handle(&self, renewal: Renewal<'_, '_>) -> Outcome {
        // SAFETY: this is the future of the node, and no lock is passed on.
        unsafe {
            self.channel()
                .renew_wake_handle(None, self.waiter(), renewal)
        }
    }

    /// What was seen by looking for the partner.
    #[inline]
    fn looked(&mut self, outcome: Outcome, cx: &Context<'_>) -> Polled<Self> {
        match outcome {
            Outcome::Waiting => self.waits(),
            // Its receiver has the value, and is not done with it: that may take long.
            Outcome::Held => self.poll_listed(cx),
            outcome => Poll::Ready(self.settled(outcome)),
        }
    }

    pub(super) fn poll_listed(&mut self, cx: &Context<'_>) -> Polled<Self> {
        let mut outcome = self.outcome();
        let _former;
        if matches!(outcome, Outcome::Waiting | Outcome::Held) {
            // A held sender has communicated: no failure takes that back. A failed branch does not
            // wait for its answer.
            if (outcome == Outcome::Waiting || D::ANSWERED) && current::branch_failed() {
                (outcome, _former) = self.unlist();
                if matches!(outcome, Outcome::Waiting | Outcome::Held) {
                    current::stay_in_branch();
                }
                if outcome == Outcome::Waiting {
                    outcome = Outcome::Poisoned;
                }
            } else {
                // SAFETY: the node was listed.
                outcome = unsafe { self.renew_wake_handle(Renewal::of(cx)) };
                if matches!(outcome, Outcome::Waiting | Outcome::Held) {
                    return self.waits();
                }
            }
        }
        self.waits_no_more();
        Poll::Ready(self.settled(outcome))
    }

    /// One that a guard's alternative has chosen waits no more, since its branch has failed.
    #[cold]
    pub(super) fn leave_failed(&mut self) {
        current::stay_in_branch();
        let (outcome, _former) = self.unlist();
        self.phase = Phase::Settled(match outcome {
            Outcome::Waiting => Outcome::Poisoned,
            outcome => outcome,
        });
    }
}

impl<'a, T, D: GivesUp<T>> Operation<'a, T, D> {
    /// Attempts it once, and gives up if that does not succeed. O(1).
    pub(crate) fn at_once(&mut self) -> Result<D::Success<'a>, D::TimeoutFailure> {
        debug_assert!(self.phase == Phase::New);
        if current::has_replay_log() {
            return self.at_once_with_log();
        }
        let attempted = self.attempt();
        self.came_at_once(attempted)
    }

    /// Attempts it without a context. The result is noted.
    #[inline(always)]
    fn attempt(&mut self) -> Attempted {
        let mut locked = self.channel().lock();
        // SAFETY: it is new, and without a context it is not listed.
        let attempted = unsafe { D::attempt(self.node_pointer(), &mut locked, None) };
        self.note(&attempted);
        Self::release(locked);
        attempted
    }

    #[inline(always)]
    fn came_at_once(&mut self, attempted: Attempted) -> Result<D::Success<'a>, D::TimeoutFailure> {
        match attempted {
            Attempted::Done(ready) => {
                ready.wake();
                Ok(self.done())
            }
            Attempted::NotNow => {
                self.phase = Phase::Over;
                // SAFETY: it has given up and was never listed: it is over now.
                Err(unsafe { D::timed_out(self) })
            }
            other => {
                // A replayed failure was not attempted.
                self.met(other).wake();
                self.drop_overwritten();
                let outcome = self.outcome();
                self.settled(outcome).map_err(D::TimeoutFailure::from)
            }
        }
    }

    /// As the process' replay log says.
    #[cold]
    #[inline(never)]
    fn at_once_with_log(&mut self) -> Result<D::Success<'a>, D::TimeoutFailure> {
        let failure = |attempted: &Attempted| match attempted {
            Attempted::NotNow => Some(replay::failure::NOTHING),
            Attempted::Ended(Ending::Poisoned) => Some(replay::failure::POISONED),
            Attempted::Ended(_) => Some(replay::failure::CLOSED),
            _ => None,
        };
        let look = || {
            self.channel().note_logged(D::SEND);
            self.attempt()
        };
        let attempted = replay::call(true, look, failure).unwrap_or_else(|failure| match failure {
            replay::failure::NOTHING => Attempted::NotNow,
            replay::failure::POISONED => Attempted::Ended(Ending::Poisoned),
            _ => Attempted::Ended(Ending::Closed),
        });
        self.came_at_once(attempted)
    }
}
