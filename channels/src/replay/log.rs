//! What operations ask the [replay log](luna_core::replay_log) of the current process, and report
//! to it; and the order in which recorded processes come to a wait point.
//!
//! Operations without a replay log do not pay for that order: whether recorded processes come is
//! part of a flag that is tested there anyway
//! ([`WaitQueues::is_unusual`](crate::wait_point::WaitQueues)).

use crate::core::Channel;
use crate::wait_point::WaitQueues;
use alloc::boxed::Box;
use alloc::collections::VecDeque;
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

/// Kinds of operations with a stamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stamped {
    /// A value that is put into a buffer.
    Storing,
    /// A value that is taken out of it.
    Taking,
    /// A rendezvous, or an operation without sides.
    Meeting,
}

/// State of a wait point about the recorded processes that come there. Guarded by its lock.
#[derive(Debug, Default)]
pub(crate) struct LogState {
    /// The last sender and the last receiver; 0 for none.
    branch_logs: [u32; 2],
    /// The greatest stamps that were given here, of sends and of receives.
    last_stamps: [u64; 2],
    /// In a replay, where an overwriting buffer overwrites only as values are taken: the stamps of
    /// the stored values. Allocated there alone, and apart, since each wait point pays for the size
    /// of this.
    #[expect(clippy::box_collection, reason = "one word instead of four")]
    stored: Option<Box<VecDeque<u64>>>,
}

/// Properties of the order of recorded processes. Apart from [`LogState`], to use padding between
/// other fields.
#[derive(Debug, Default)]
pub(crate) struct Order {
    /// Whether the order in which they get through has to be recorded: there are several on a side,
    /// or a buffer overwrites.
    pub(crate) is_ordered: bool,
    /// Whether an operation that is not recorded took part meanwhile.
    has_outsider: bool,
}

impl LogState {
    /// Whether a recorded process has come.
    pub(crate) fn is_used(&self) -> bool {
        self.branch_logs != [0; 2]
    }
}

impl WaitQueues {
    /// Notes that the current process, which has a replay log, comes as a sender or as a receiver.
    #[cold]
    pub(crate) fn note_recorded(&mut self, is_sender: bool) {
        let is_first = !self.log_state.is_used();
        let branch_log = current::replay_log(|log| log.branch_log()).unwrap_or_default();
        let last = &mut self.log_state.branch_logs[usize::from(is_sender)];
        let last = core::mem::replace(last, branch_log);
        self.order.is_ordered |= last != 0 && last != branch_log;
        if is_first {
            // All recorded operations are noted, so a waiter is not a recorded one.
            self.order.has_outsider = !(self.senders.is_empty() && self.receivers.is_empty());
            self.find_whether_plain();
        }
        if core::mem::take(&mut self.order.has_outsider) {
            current::replay_log(|log| log.outside(OUTSIDE_PARTNER));
        }
    }

    /// Notes that an operation takes part here, where recorded processes come: it may be one that
    /// is not recorded.
    pub(crate) fn note_partner(&mut self) {
        self.order.has_outsider |= self.log_state.is_used() && !current::has_replay_log();
    }

    /// The stamp of the present event, if it has to have one: see
    /// [`ReplayLog::stamp`](luna_core::replay_log::ReplayLog::stamp).
    pub(crate) fn stamp(&mut self, of: Stamped) -> u64 {
        match self.log_state.is_used() {
            true => self.stamp_if(self.order.is_ordered, of),
            false => 0,
        }
    }

    /// As [`stamp`](Self::stamp); with `several`, the order is recorded in any case.
    ///
    /// A replay that gets through out of order is noticed here. An operation that takes from a
    /// buffer may come after one that stored later: it finds what was there then
    /// ([`overwritten`](Self::overwritten)).
    pub(crate) fn stamp_if(&mut self, several: bool, of: Stamped) -> u64 {
        current::replay_log(|log| {
            let stamp = log.stamp(several);
            if stamp == 0 {
                return 0;
            }
            let [sends, receives] = &mut self.log_state.last_stamps;
            let after = match of {
                Stamped::Taking => *receives,
                Stamped::Storing | Stamped::Meeting => (*sends).max(*receives),
            };
            if stamp < after {
                log.differs("an operation gets through after one that came after it");
            }
            if of != Stamped::Storing {
                *receives = after.max(stamp);
            }
            if of != Stamped::Taking {
                *sends = after.max(stamp);
            }
            stamp
        })
        .unwrap_or(OUTSIDER)
    }

    /// In a replay: a value with this stamp goes behind the `stored` ones.
    pub(crate) fn note_stored(&mut self, stamp: u64, stored: usize) {
        let stamps = self.stamps_of(stored);
        stamps.push_back(stamp);
    }

    /// In a replay: the first of the `stored` values is taken by a receive with this stamp.
    pub(crate) fn note_taken(&mut self, stored: usize, stamp: u64) {
        let come = self.stamps_of(stored).pop_front().unwrap_or_default();
        if stamp != 0 && come > stamp {
            current::replay_log(|log| log.differs("a receive finds a value that came after it"));
        }
    }

    fn stamps_of(&mut self, stored: usize) -> &mut VecDeque<u64> {
        let stamps = self.log_state.stored.get_or_insert_default();
        // Values from before the begin of the record, and values that were given back, have none.
        while stamps.len() < stored {
            stamps.push_front(0);
        }
        stamps.truncate(stored);
        stamps
    }

    /// In a replay: the number of the `stored` values, counted from the first, that a buffer of
    /// this capacity had overwritten when the recorded receive with this stamp came; they count as
    /// gone. They are counted all at once, since several receives may come late.
    pub(crate) fn overwritten(
        &mut self,
        stored: usize,
        capacity: usize,
        stamp: u64,
        keeps_newest: bool,
    ) -> core::ops::Range<usize> {
        let stamps = self.stamps_of(stored);
        let come = stamps.iter().take_while(|&&come| come <= stamp).count();
        let first = if keeps_newest { 0 } else { capacity - 1 };
        let range = first..first + come.saturating_sub(capacity);
        stamps.drain(range.clone());
        range
    }
}

/// A partner that a replay log cannot represent.
pub(super) const OUTSIDE_PARTNER: &str =
    "a communication with a thread or a process that is not recorded";

impl<T> Channel<T> {
    /// As [`note_logged`](Self::note_logged), of an alternative that stays registered: its next
    /// channel is not determined, so all that happens there is in order.
    #[cold]
    pub(crate) fn note_alternative(&self) {
        self.note_logged(false);
        self.lock().lists.order.is_ordered = true;
    }

    /// Notes that the current process, which has a replay log, comes as a sender or a receiver.
    #[cold]
    pub(crate) fn note_logged(&self, is_sender: bool) {
        let mut locked = self.lock();
        locked.lists.note_recorded(is_sender);
        if is_sender || !current::is_replayed() {
            return;
        }
        let Some(stamp) = current::replay_log(|log| log.stamp(true)).filter(|&stamp| stamp != 0)
        else {
            return;
        };
        let overwritten = locked.take_overwritten(stamp);
        // The user's code, so not under the lock.
        drop(locked);
        drop(overwritten);
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use crate::inspect::{Identity, WaitPointKind};
    use crate::wait_point::WaitPoint;

    #[track_caller]
    fn check(come: &[u64], capacity: usize, stamp: u64, keeps_newest: bool) -> Vec<usize> {
        let wait_point = WaitPoint::new(Identity::new(WaitPointKind::Buffered(capacity)));
        let mut lists = wait_point.lock_lists();
        for (stored, &stamp) in come.iter().enumerate() {
            lists.note_stored(stamp, stored);
        }
        let gone = lists.overwritten(come.len(), capacity, stamp, keeps_newest);
        (0..come.len()).filter(|at| !gone.contains(at)).collect()
    }

    #[test]
    fn what_was_overwritten_is_what_came_too_many_before_the_receive() {
        assert_eq!(check(&[1, 2, 3, 7], 2, 5, true), [1, 2, 3]);
        assert_eq!(check(&[1, 2, 3, 7], 2, 5, false), [0, 2, 3]);
        assert_eq!(check(&[1, 2, 3, 7], 3, 5, true), [0, 1, 2, 3]);
        assert_eq!(check(&[1, 2, 3, 7], 1, 9, true), [3]);
        assert_eq!(check(&[1, 2, 3, 7], 1, 9, false), [3]);
        assert_eq!(check(&[], 1, 9, true), [0_usize; 0]);
    }
}
