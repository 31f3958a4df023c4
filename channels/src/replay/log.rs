//! What operations ask the [replay log](luna_core::replay_log) of the current process, and report
//! to it.

use super::order::{OUTSIDE_PARTNER, Stamped};
use crate::wait_point::WaitQueues;
use core::task::{Context, Poll};
use luna_core::current;
use luna_core::replay_log::{Event, OUTSIDER, ReplayLog, Turn, What};
use luna_platform::clock::Instant;

/// How an operation failed, as a number.
pub(crate) mod failure {
    pub(crate) const NOTHING: u64 = 0;
    pub(crate) const CLOSED: u64 = 1;
    pub(crate) const POISONED: u64 = 2;
}

/// Lets an operation in.
pub(super) fn enter(cx: &mut Context<'_>) -> Poll<Turn> {
    current::replay_log(|log| log.enter(cx)).unwrap_or(Poll::Ready(Turn::Record))
}

/// The stamp of a success: as its partner gave it, or else its own.
pub(crate) fn stamp(of_partner: u64, own: u64) -> u64 {
    match of_partner {
        0 => own,
        stamp => current::replay_log(|log| known(log, stamp)).unwrap_or(0),
    }
}

/// A stamp for an operation that gets one in any case.
pub(crate) fn own_stamp() -> u64 {
    current::replay_log(|log| log.stamp(true)).unwrap_or(0)
}

/// As [`own_stamp`], of an operation that has met no partner, under the lock where it succeeded.
pub(crate) fn meeting(lists: &mut WaitQueues) -> u64 {
    lists.stamp_if(true, Stamped::Meeting)
}

/// In a replay: whether the other processes have done what comes before the present operation.
pub(crate) fn settle(cx: &mut Context<'_>) -> Poll<()> {
    current::replay_log(|log| log.settle(cx)).unwrap_or(Poll::Ready(()))
}

/// The replayed operation cannot have its recorded outcome.
#[cold]
pub(crate) fn differs<R>(what: &'static str) -> Poll<R> {
    current::replay_log(|log| log.differs(what));
    Poll::Pending
}

/// Whether the current process has a replay log.
#[inline(always)]
pub(crate) fn is_on() -> bool {
    current::has_replay_log()
}

/// Whether the process is replayed, so that timeouts come from the replay log only.
#[inline]
pub(crate) fn is_replayed() -> bool {
    current::has_replay_log() && current::is_replayed()
}

/// Whether the process of a completed operation is still held by its replay log.
pub(crate) fn is_held(cx: &mut Context<'_>) -> bool {
    current::replay_log(|log| log.hold(cx).is_pending()).unwrap_or_default()
}

/// A replayed operation has completed without waiting. Returns whether its process is held.
pub(crate) fn is_held_after(cx: &mut Context<'_>) -> bool {
    current::replay_log(|log| {
        log.leave(Event::done(log.own_stamp()));
        log.hold(cx).is_pending()
    })
    .unwrap_or_default()
}

/// The stamp given by a partner; one that is not recorded gives none.
fn known(log: &dyn ReplayLog, order: u64) -> u64 {
    if order == OUTSIDER {
        log.outside(OUTSIDE_PARTNER);
        return 0;
    }
    order
}

/// Records the result of an operation that did not wait.
pub(crate) fn leave(event: Event) {
    current::replay_log(|log| log.leave(event));
}

/// Records that the current process does something that cannot be recorded.
#[cold]
pub(crate) fn outside(construct: &'static str) {
    current::replay_log(|log| log.outside(construct));
}

/// The time: as it was recorded, in a process with a replay log.
pub(crate) fn now() -> Instant {
    if current::has_replay_log() {
        return luna_core::replay_log::now();
    }
    Instant::now()
}

/// Performs an operation that does not wait, and records its result; in a replay, performs it as
/// the replay log says. `None`: it is to fail with the recorded number.
#[cold]
pub(crate) fn call<R>(
    takes: bool,
    look: impl FnOnce() -> R,
    failure_of: impl FnOnce(&R) -> Option<u64>,
) -> Result<R, u64> {
    match current::replay_log(|log| log.call(takes)) {
        None => Ok(look()),
        Some(Turn::Given(Event {
            what: What::Failed,
            number,
            ..
        })) => {
            leave(Event::failed(number));
            Err(number)
        }
        Some(turn) => {
            let came_to = look();
            let failure = failure_of(&came_to);
            current::replay_log(|log| match failure {
                Some(_) if turn != Turn::Record => {
                    log.differs("an operation at once does not succeed");
                }
                Some(number) => log.leave(Event::failed(number)),
                // Its effects have the stamp of the lock under which they were made, or this stamp.
                None => log.leave(Event::done(match log.own_stamp() {
                    0 if takes => log.stamp(true),
                    stamp => stamp,
                })),
            });
            Ok(came_to)
        }
    }
}

/// Reads a state that others change: a replay sees what the recorded process saw.
#[cold]
pub(crate) fn look(look: impl FnOnce() -> u64) -> u64 {
    match current::replay_log(|log| log.call(false)) {
        Some(Turn::Given(event)) => {
            leave(Event::new(What::Chosen, event.number, 0));
            event.number
        }
        _ => {
            let seen = look();
            leave(Event::new(What::Chosen, seen, 0));
            seen
        }
    }
}

/// An operation was dropped before it was decided. `is_new`: the log had not let it in, or it was
/// never polled.
#[cold]
pub(crate) fn abandon(is_new: bool) {
    current::replay_log(|log| log.abandon(!is_new));
}
