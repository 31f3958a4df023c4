//! How the replay log of a recorded or replayed process drives an operation.
//!
//! This is the one place where an operation meets the [log](luna_core::replay_log). Its poll comes
//! here on the slow path, and only in a process with a log. [`poll`] lets it in when the log says
//! so, polls it as usual, and reports the outcome. [`stop`] does the same for one that gives up.
//!
//! ```text
//!          enter                  poll_unlogged               hold
//!   New ---------> (let in) ----------------------> Waits --> Met ------> the output
//!    |                 |                                                     ^
//!    |                 '--> GaveWay, or the output at once ------------------'
//!    '--> the recorded failure
//! ```

mod log;

pub(crate) use log::{
    LogState, Order, Stamped, abandon, call, differs, failure, is_held_after, is_on, is_replayed,
    look, meeting, now, outside, own_stamp, settle, stamp,
};

use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll, ready};
use log::{enter, is_held, leave};
use luna_core::current;
use luna_core::events;
use luna_core::replay_log::{Event, Turn, What};
#[cfg(not(loom))]
use {core::time::Duration, luna_platform::clock::Instant};

/// Where an operation is, as far as a replay log needs it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stage {
    /// It has done nothing, or the log has not let it in.
    New,
    /// It waits, and has not succeeded yet. The log has let it in.
    Waits,
    /// It has waited and succeeded. Its output was not returned.
    Met,
    /// It has succeeded, and lets others run.
    GaveWay,
    /// It has failed so, and lets others run.
    Failed(Event),
    /// It was begun where there was no log.
    Elsewhere,
    /// Its output was returned.
    Over,
}

/// An operation that a replay log can drive.
pub(crate) trait Logged {
    /// What it comes to.
    type Output;

    fn stage(&self) -> Stage;

    /// The log is about to be asked whether to let it in.
    fn approach(&mut self) {}

    /// The log has let it in, and it is about to be polled. In a replay it gets the recorded
    /// outcome. Pending: it has to wait for that, or cannot have it.
    fn come(&mut self, turn: Turn, cx: &mut Context<'_>) -> Poll<()>;

    /// Polls it as in a process without a log.
    fn poll_unlogged(&mut self, cx: &mut Context<'_>) -> Poll<Self::Output>;

    /// It waits: its next poll is to come to the log too.
    fn wait_logged(&mut self) {}

    /// The event of its success. It has its `output` still, unless that is given. `own` is the
    /// stamp that it took itself, or 0.
    ///
    /// # Safety
    ///
    /// It has [come](Self::come), and no partner can settle it any more.
    unsafe fn success(&self, output: Option<&Self::Output>, own: u64) -> Event;

    /// Whether it can [keep](Self::keep) its output. If not, its poll asks the log itself whether
    /// its process may go on.
    const KEEPS: bool = false;

    /// Keeps the output for the next poll, since its process must not go on yet.
    fn keep(&mut self, _output: Self::Output) {}

    /// Ends it with the recorded failure. Pending: it has none.
    fn fail(&mut self, _number: u64) -> Poll<Self::Output> {
        differs("an operation that cannot fail")
    }

    /// How it failed; `None` is a success.
    fn failure(_output: &Self::Output) -> Option<Event> {
        None
    }

    /// What it returns in a replay that finds its channel closed, although it succeeded in the
    /// recording. `None`: it fails.
    fn closed_later(&self) -> Option<Self::Output> {
        None
    }
}

/// An operation that can give up before it is decided.
pub(crate) trait GiveUp: Logged + Future {
    /// What comes of it then.
    type Outcome;

    /// Whether it is decided, and lets others run before it returns its output.
    fn lets_others_run(&self) -> bool;

    /// Gives up, unless it is decided already.
    fn give_up(self: Pin<&mut Self>) -> Self::Outcome;

    /// The same outcome of one that did not have to give up.
    fn in_time(output: <Self as Future>::Output) -> Self::Outcome;

    /// How it failed, or that it gave up; `None` is a success.
    fn failure_in_time(outcome: &Self::Outcome) -> Option<Event>;
}

/// Blocks this thread until the operation is over, for at most `timeout`: then it gives up.
#[cfg(not(loom))]
#[track_caller]
pub(crate) fn block_for<O: GiveUp>(operation: O, timeout: Duration) -> O::Outcome {
    let mut operation = core::pin::pin!(operation);
    match luna_core::park::block_on_until(operation.as_mut(), Instant::now() + timeout) {
        Some(output) => O::in_time(output),
        None => operation.give_up(),
    }
}

/// The event of an operation that found its channel closed or poisoned.
pub(crate) fn ended(is_poisoned: bool) -> Event {
    Event::failed(match is_poisoned {
        true => failure::POISONED,
        false => failure::CLOSED,
    })
}

/// The event of an operation that gave up.
pub(crate) fn gave_up() -> Event {
    Event::new(What::TimedOut, 0, 0)
}

/// Polls an operation; in a process with a replay log as that says, and reports the outcome there.
#[inline]
pub(crate) fn poll<O: Logged>(operation: &mut O, cx: &mut Context<'_>) -> Poll<O::Output> {
    match is_on() {
        true => poll_logged(operation, cx),
        false => operation.poll_unlogged(cx),
    }
}

#[cold]
#[inline(never)]
fn poll_logged<O: Logged>(operation: &mut O, cx: &mut Context<'_>) -> Poll<O::Output> {
    let before = operation.stage();
    match before {
        Stage::New => {
            operation.approach();
            match ready!(enter(cx)) {
                Turn::Given(event) if event.what == What::Failed => {
                    let output = ready!(operation.fail(event.number));
                    leave(event);
                    return Poll::Ready(output);
                }
                // The future around it gives up: see `stop`.
                Turn::Given(event) if event.what == What::TimedOut => return Poll::Pending,
                turn => ready!(operation.come(turn, cx)),
            }
        }
        Stage::Met => {
            // SAFETY: it came before it waited, and it has succeeded.
            leave(unsafe { operation.success(None, 0) });
            if is_held(cx) {
                return Poll::Pending;
            }
        }
        Stage::GaveWay if is_held(cx) => return Poll::Pending,
        // The log has the outcome.
        Stage::GaveWay | Stage::Failed(_) | Stage::Over => return operation.poll_unlogged(cx),
        Stage::Elsewhere => {
            outside("an operation that began in no recorded process");
            return operation.poll_unlogged(cx);
        }
        Stage::Waits => {}
    }
    let polled = operation.poll_unlogged(cx);
    let failure = match (&polled, operation.stage()) {
        (Poll::Ready(output), _) => O::failure(output),
        (Poll::Pending, Stage::GaveWay) => None,
        (Poll::Pending, Stage::Failed(failure)) => Some(failure),
        (Poll::Pending, stage) => {
            if stage != Stage::New {
                operation.wait_logged();
            }
            return Poll::Pending;
        }
    };
    match failure {
        Some(failure)
            if failure.number == failure::CLOSED
                && current::is_replayed()
                && let Some(output) = operation.closed_later() =>
        {
            leave(Event::done(0));
            return Poll::Ready(output);
        }
        Some(failure) => {
            leave(failure);
            return polled;
        }
        None => {}
    }
    let own = match before {
        // It may have met a partner that waited.
        Stage::New => current::replay_log(|log| log.own_stamp()).unwrap_or(0),
        _ => 0,
    };
    let output = match polled {
        Poll::Ready(output) => Some(output),
        Poll::Pending => None,
    };
    // SAFETY: it has come, in this poll or before it waited, and it has succeeded.
    leave(unsafe { operation.success(output.as_ref(), own) });
    match output {
        Some(output) if O::KEEPS && is_held(cx) => {
            operation.keep(output);
            Poll::Pending
        }
        Some(output) => Poll::Ready(output),
        None => Poll::Pending,
    }
}

/// Polls an operation that gives up when `stop` has ended.
#[inline(always)]
pub(crate) fn poll_until<O: GiveUp, S: Future<Output = ()>>(
    mut operation: Pin<&mut O>,
    stop: Pin<&mut S>,
    cx: &mut Context<'_>,
) -> Poll<O::Outcome> {
    if let Poll::Ready(output) = operation.as_mut().poll(cx) {
        return Poll::Ready(O::in_time(output));
    }
    poll_stop(operation, stop, cx)
}

/// As [`poll_until`], of an operation that is pending.
#[inline(never)]
fn poll_stop<O: GiveUp, S: Future<Output = ()>>(
    operation: Pin<&mut O>,
    stop: Pin<&mut S>,
    cx: &mut Context<'_>,
) -> Poll<O::Outcome> {
    // One that has communicated, or failed, lets others run, and is over then, whatever the time
    // is.
    if operation.lets_others_run() {
        return Poll::Pending;
    }
    if current::has_replay_log() {
        return self::stop(operation, stop, cx);
    }
    match events::beside(|| stop.poll(cx)) {
        Poll::Ready(()) => Poll::Ready(operation.give_up()),
        Poll::Pending => Poll::Pending,
    }
}

/// A delay, and whether it has come by the log.
struct Delay<'a, P> {
    has_come: &'a mut bool,
    poll: P,
}

impl<P: FnMut(&mut Context<'_>) -> Poll<()>> Logged for Delay<'_, P> {
    type Output = ();

    const KEEPS: bool = true;

    fn stage(&self) -> Stage {
        match self.has_come {
            true => Stage::GaveWay,
            false => Stage::New,
        }
    }

    /// A replayed one does not wait for the time.
    fn come(&mut self, turn: Turn, _: &mut Context<'_>) -> Poll<()> {
        *self.has_come = turn != Turn::Record;
        Poll::Ready(())
    }

    fn poll_unlogged(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        match self.has_come {
            true => Poll::Ready(()),
            false => (self.poll)(cx),
        }
    }

    unsafe fn success(&self, _: Option<&()>, _: u64) -> Event {
        Event::done(0)
    }

    fn keep(&mut self, (): ()) {
        *self.has_come = true;
    }
}

/// Polls a delay as the replay log says. `has_come` belongs to it, and is at first `false`.
#[cold]
pub(crate) fn poll_delay(
    has_come: &mut bool,
    poll: impl FnMut(&mut Context<'_>) -> Poll<()>,
    cx: &mut Context<'_>,
) -> Poll<()> {
    self::poll(&mut Delay { has_come, poll }, cx)
}

/// Lets an operation that is not decided give up, as the replay log says: a replayed one gives up
/// when the recorded one did, whatever the time is or has happened.
#[cold]
fn stop<O: GiveUp, S: Future<Output = ()>>(
    mut operation: Pin<&mut O>,
    stop: Pin<&mut S>,
    cx: &mut Context<'_>,
) -> Poll<O::Outcome> {
    if current::is_replayed() {
        let is_new = operation.stage() == Stage::New;
        return match is_new && enter(cx) == Poll::Ready(Turn::Given(gave_up())) {
            true => {
                leave(gave_up());
                Poll::Ready(operation.give_up())
            }
            false => Poll::Pending,
        };
    }
    let is_logged = matches!(operation.stage(), Stage::Waits | Stage::Met);
    ready!(events::beside(|| current::without_replay_log(
        || stop.poll(cx)
    )));
    let outcome = operation.as_mut().give_up();
    match O::failure_in_time(&outcome) {
        Some(failure) => leave(failure),
        // SAFETY: it came before it waited, and its partner has completed it.
        None if is_logged => leave(unsafe { operation.success(None, 0) }),
        None => {}
    }
    Poll::Ready(outcome)
}
