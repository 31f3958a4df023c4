//! What operations tell the [tape](luna_platform::tape) of their process, if it is recorded or replayed.

use crate::place::Place;
use luna_platform::current;
use luna_platform::tape::{Event, Tape, Turn, What};
use std::task::{Context, Poll};

/// How an operation failed, as a number.
pub(crate) mod failure {
    pub(crate) const NOTHING: u64 = 0;
    pub(crate) const CLOSED: u64 = 1;
    pub(crate) const POISONED: u64 = 2;
}

/// Whether an operation that has just completed without waiting is to be polled again before it gives its outcome: its process lets others run
/// ([`gives_way`](crate::gives_way)), or is held.
#[inline]
pub(crate) fn completes_later(cx: &mut Context<'_>) -> bool {
    if current::is_taped() && completed(cx) {
        return true;
    }
    crate::gives_way(cx)
}

#[cold]
fn completed(cx: &mut Context<'_>) -> bool {
    current::tape(|tape| {
        tape.leave(Event::done(tape.own_stamp()));
        tape.hold(cx).is_pending()
    })
    .unwrap_or_default()
}

/// Whether the process of a completed operation is still held.
#[inline]
pub(crate) fn is_held(cx: &mut Context<'_>) -> bool {
    current::is_taped() && current::tape(|tape| tape.hold(cx).is_pending()).unwrap_or_default()
}

/// An operation is dropped before it came to anything.
#[inline]
pub(crate) fn abandoned() {
    if current::is_taped() {
        current::tape(|tape| tape.abandon());
    }
}

/// Whether the process is replayed, so that no time runs out of itself.
#[inline]
pub(crate) fn is_replayed() -> bool {
    current::is_taped() && current::tape(|tape| tape.is_replay()).unwrap_or_default()
}

/// Does what does not wait: as it was given, or as ever, and tells what came of it. `None`: it is to fail as the number says.
pub(crate) fn call<R>(
    takes: bool,
    look: impl FnOnce() -> R,
    failure_of: impl FnOnce(&R) -> Option<u64>,
) -> Result<R, u64> {
    match current::tape(|tape| tape.call(takes)) {
        None => Ok(look()),
        Some(Turn::Given(Event {
            what: What::Failed,
            number,
            ..
        })) => {
            current::tape(|tape| tape.leave(Event::failed(number)));
            Err(number)
        }
        Some(turn) => {
            let came_to = look();
            let failure = failure_of(&came_to);
            current::tape(|tape| match failure {
                Some(_) if turn != Turn::Record => {
                    tape.differs("an operation at once does not succeed");
                }
                Some(number) => tape.leave(Event::failed(number)),
                // What it takes has a stamp of the lock that it was taken under, or else it has it by now.
                None => tape.leave(Event::done(match tape.own_stamp() {
                    0 if takes => tape.stamp(true),
                    stamp => stamp,
                })),
            });
            Ok(came_to)
        }
    }
}

/// Lets an operation in that has no other outcome than success, and others than these: gives how it failed, if that is given.
pub(crate) fn enter(tape: &dyn Tape, cx: &mut Context<'_>) -> Poll<Result<Turn, u64>> {
    tape.enter(cx).map(|turn| match turn {
        Turn::Given(Event {
            what: What::Failed,
            number,
            ..
        }) => Err(number),
        turn => Ok(turn),
    })
}

/// How far a lock is, of a process with a tape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Locking {
    New,
    Entered,
}

/// Lets a lock in. `true`: it is to wait for that.
#[cold]
pub(crate) fn waits_to_lock(cx: &mut Context<'_>, locking: &mut Locking) -> bool {
    if *locking != Locking::New {
        return false;
    }
    let waits = current::tape(|tape| tape.enter(cx).is_pending()).unwrap_or_default();
    if !waits {
        *locking = Locking::Entered;
    }
    waits
}

/// Tells what a lock has come to. Its stamp is taken now: the mutex is held, so those of its holders are in the order of their holding it.
#[cold]
pub(crate) fn has_waited_to_lock(place: &Place, timed_out: bool) {
    let event = match timed_out {
        true => Event::new(What::TimedOut, 0, 0),
        false => Event::done(place.lock().stamp_if(true)),
    };
    current::tape(|tape| tape.leave(event));
}

/// Whether a lock with a deadline that begins is to give up, since the recorded one did.
#[inline]
pub(crate) fn has_no_time_to_lock(cx: &mut Context<'_>, is_new: bool) -> bool {
    is_new && current::is_taped() && gives_up(cx)
}

#[cold]
fn gives_up(cx: &mut Context<'_>) -> bool {
    current::tape(|tape| {
        let timed_out = Event::new(What::TimedOut, 0, 0);
        let gives_up = tape.enter(cx) == Poll::Ready(Turn::Given(timed_out));
        if gives_up {
            tape.leave(timed_out);
        }
        gives_up
    })
    .unwrap_or_default()
}
