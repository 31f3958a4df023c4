//! How a replay log drives an operation; and one that gives up: at a deadline, or when something
//! else happens.

use super::{Direction, GivesUp, Operation, Phase, Receiving, Sending};
use crate::error::Ended;
use crate::extended::Releasing;
use crate::in_place::InPlace;
use crate::inspect;
use crate::replay::{self, GiveUp, Logged, Stage};
use crate::source::InNode;
use crate::waiter::{Outcome, Waiter};
use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll};
use luna_core::current;
use luna_core::replay_log::{Event, Turn};
use luna_core::timer_queue::Sleep;
use pin_project_lite::pin_project;

/// The event of a failure.
fn failed(failure: &impl Ended) -> Event {
    failure
        .poisoned()
        .map_or_else(replay::gave_up, replay::ended)
}

impl<'a, T, D: Direction<T>> Logged for Operation<'a, T, D> {
    type Output = <Self as Future>::Output;

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
        self.channel().note_logged(D::SEND);
        // SAFETY: a new operation's node is known to its future alone.
        unsafe { Waiter::clear_order(self.waiter()) };
        Poll::Ready(())
    }

    fn poll_unlogged(&mut self, cx: &mut Context<'_>) -> Poll<<Self as Logged>::Output> {
        match self.phase {
            Phase::New => self.poll_new(cx),
            Phase::Listed | Phase::Logged => self.poll_listed(cx),
            Phase::GaveWay => Poll::Ready(self.settled(Outcome::Done)),
            Phase::Settled(outcome @ (Outcome::Poisoned | Outcome::Closed)) => {
                if current::branch_failed() {
                    current::stay_in_branch();
                }
                Poll::Ready(self.settled(outcome))
            }
            Phase::Overwrote | Phase::Settled(_) | Phase::Over => {
                panic!("a {} was polled after it was over", D::NAME)
            }
        }
    }

    fn wait_logged(&mut self) {
        self.phase = Phase::Logged;
    }

    unsafe fn success(&self, _: Option<&<Self as Logged>::Output>, own: u64) -> Event {
        // SAFETY: it has come, which has cleared the stamp, and no partner can settle it any more,
        // as is demanded here: so only its future accesses the node.
        let of_partner = unsafe { Waiter::order(self.waiter()) };
        Event::done(replay::stamp(of_partner, own))
    }

    fn fail(&mut self, number: u64) -> Poll<<Self as Logged>::Output> {
        self.phase = Phase::Over;
        let poisoned = number == replay::failure::POISONED;
        inspect::note_failure(self.channel().wait_point(), D::SEND, poisoned);
        // SAFETY: it is over, as its log has it, and was never listed.
        Poll::Ready(Err(unsafe { D::failed(self, poisoned) }))
    }

    fn failure(output: &<Self as Logged>::Output) -> Option<Event> {
        let failure = output.as_ref().err()?;
        (!failure.has_communicated()).then(|| failed(failure))
    }

    fn closed_later(&self) -> Option<<Self as Logged>::Output> {
        D::closed_later()
    }
}

impl<'a, T, D: GivesUp<T>> GiveUp for Operation<'a, T, D> {
    type Outcome = Result<D::Success<'a>, D::TimeoutFailure>;

    fn lets_others_run(&self) -> bool {
        matches!(self.phase, Phase::GaveWay | Phase::Settled(_))
    }

    /// It withdraws: exact, since the outcome is looked at first.
    fn give_up(self: Pin<&mut Self>) -> Self::Outcome {
        let this = self.in_place();
        let (outcome, _former) = match this.phase {
            Phase::New => (Outcome::Waiting, None),
            Phase::GaveWay => (Outcome::Done, None),
            Phase::Settled(outcome) => (outcome, None),
            Phase::Listed | Phase::Logged => this.unlist(),
            Phase::Overwrote | Phase::Over => {
                panic!("a {} was given up after it was over", D::NAME)
            }
        };
        match outcome {
            Outcome::Waiting => {
                this.phase = Phase::Over;
                // SAFETY: it has given up and is in no queue: it is over now.
                Err(unsafe { D::timed_out(this) })
            }
            outcome => this.settled(outcome).map_err(D::TimeoutFailure::from),
        }
    }

    fn in_time(output: <Self as Logged>::Output) -> Self::Outcome {
        output.map_err(D::TimeoutFailure::from)
    }

    fn failure_in_time(outcome: &Self::Outcome) -> Option<Event> {
        outcome.as_ref().err().map(failed)
    }
}

/// A send under way that gives up when `S` has ended, which is a deadline or anything else: see
/// [`Sender::send_timeout`](crate::Sender::send_timeout) and
/// [`Sender::send_unless`](crate::Sender::send_unless).
pub type SendTimeout<'a, T, S = Sleep> = Timed<'a, T, Sending<InNode>, S>;

/// A receive under way that gives up when `S` has ended, which is a deadline or anything else: see
/// [`Receiver::recv_timeout`](crate::Receiver::recv_timeout) and
/// [`Receiver::recv_unless`](crate::Receiver::recv_unless).
pub type RecvTimeout<'a, T, S = Sleep> = Timed<'a, T, Receiving<Releasing>, S>;

pin_project! {
    /// An operation until `S` has ended: a [`SendTimeout`] or a [`RecvTimeout`].
    #[derive(Debug)]
    #[must_use = "an operation does nothing unless awaited"]
    pub struct Timed<'a, T, D: GivesUp<T>, S> {
        #[pin]
        pub(super) operation: Operation<'a, T, D>,
        #[pin]
        pub(super) stop: S,
    }
}

impl<'a, T, D: GivesUp<T>, S: Future<Output = ()>> Future for Timed<'a, T, D, S> {
    type Output = Result<D::Success<'a>, D::TimeoutFailure>;

    #[inline(always)]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.project();
        replay::poll_until(this.operation, this.stop, cx)
    }
}
