//! The ready processes of this thread, and the points where the current process yields.

use super::branch::lowered;
use super::run_queue::RunQueue;
use super::{Process, QueueEnd, THREAD, is_replayed, local, plain_turn, process};
use core::ptr::NonNull;
use core::task::Context;

#[inline]
pub(crate) fn with_queue<R>(f: impl FnOnce(&RunQueue) -> R) -> R {
    f(&local().queue)
}

/// The levels at which this thread's executor has a ready process, one bit each.
#[inline]
pub fn ready_levels() -> u32 {
    with_queue(RunQueue::bits)
}

/// Pops the next process of this thread's run queue. The process was readied by
/// [`Process::ready_at`] or a wake handle, and is live until it has ended.
///
/// # Safety
///
/// The caller gives the process a turn ([`give_turn`](super::give_turn),
/// [`with_process`](super::with_process)) or ends it before it is readied again: until then it
/// counts as queued.
#[inline(always)]
pub unsafe fn next_ready() -> Option<NonNull<Process>> {
    Some(with_queue(RunQueue::pop)?.cast())
}

/// Whether a process of higher level than the current one, or the current branch, is ready on its
/// executor: then a completed communication yields to it. So it does in a lowered branch if the
/// current process is to run again at a higher level.
#[inline]
pub fn is_outranked() -> bool {
    THREAD.with(|thread| {
        thread.process.get().is_some_and(|process| {
            // SAFETY: as in `process`: `with_process` or `give_turn` has set the pointer, and the
            // process is live as long as it is set.
            let process = unsafe { process.as_ref() };
            let level = process
                .level()
                .saturating_sub(thread.branch.get().lowered());
            thread.queue.has_above(level)
                || process.level() > level && process.is_owned() && process.yields()
        })
    })
}

/// Readies the current process again, at `place` among those of its level; more urgent ones run
/// before it in any case. The caller returns `Pending`. Outside of LUNA processes, or within a
/// combinator, the waker is woken.
#[inline]
pub fn ready_again(cx: &Context<'_>, place: QueueEnd) {
    match plain_turn(cx) {
        // SAFETY: this is the executor's thread, and the process lives while it is polled.
        Some(process) if place == QueueEnd::Back => unsafe {
            process.ready_at(process.level(), QueueEnd::Back);
        },
        _ => ready_again_attentively(cx, place),
    }
}

/// Lets the other processes of its level, and all of higher ones, run before the current process
/// runs again. The caller returns `Pending`. In a [plain turn](plain_turn) the process is queued
/// when the turn is over, so that the executor can exchange it with the next one. A process that
/// [wakes itself](super::Process::yields_to_wake) does the same.
#[inline]
pub fn yield_turn(cx: &Context<'_>) {
    match plain_turn(cx) {
        Some(process) => process.yield_at_end(),
        None => ready_again_attentively(cx, QueueEnd::Back),
    }
}

/// Queues a process again that was taken as the next one and has had no turn: it comes first again.
///
/// # Safety
///
/// [`next_ready`] or [`Process::after_turn`](super::Process::after_turn) has returned it, and
/// nothing was done with it since.
#[cold]
pub unsafe fn put_back(process: NonNull<Process>) {
    // SAFETY: the caller promises that it was just taken, so it is live and in no queue; the link
    // is the first field of a process.
    with_queue(|queue| unsafe {
        let link = process.cast::<super::run_queue::Link>();
        queue.push_front(link.as_ref().level.get(), link);
    });
}

/// Takes a process out of this thread's run queue, if it is there.
///
/// # Safety
///
/// This is its executor's thread, which has not taken it out for a turn that has not begun.
pub(crate) unsafe fn unqueue(process: &Process) {
    if process.is_queued() {
        // SAFETY: by its state it is in the queue, as the caller promises.
        with_queue(|queue| unsafe { queue.remove(process.link()) });
    }
}

#[cold]
#[inline(never)]
fn ready_again_attentively(cx: &Context<'_>, place: QueueEnd) {
    process(|process| match process {
        // SAFETY: this is the executor's thread, and the process lives while it is polled.
        Some(process) if process.is_owned() && process.is_polled_with(cx) => unsafe {
            process.ready_here(lowered(), place);
        },
        _ => cx.waker().wake_by_ref(),
    });
}

/// Yields to processes that outrank the current branch. If there are any, the process is ready
/// again already, and the caller returns `Pending`. A branch does not yield if its process can be
/// readied at its own level alone (a combinator polls it with wakers of its own): the process would
/// run again before them.
#[inline]
pub fn yield_if_outranked(cx: &Context<'_>) -> bool {
    is_outranked() && {
        // A waker readies the process at its own level alone.
        let has_level = lowered() == 0
            || process(|process| {
                process.is_some_and(|own| own.is_owned() && own.is_polled_with(cx))
            });
        if has_level {
            ready_again(cx, QueueEnd::Front);
        }
        has_level
    }
}

/// How many operations one poll may complete without waiting before the process yields. One that
/// readies its partner while no process is ready is not counted: there is one at most.
///
/// Without this bound, a process with partners that are always ready would keep its executor from
/// its timers and from remote wakes.
pub const OPERATIONS_PER_POLL: u32 = 64;

/// Counts an operation that completed without waiting; `false` when this poll has used up
/// [`OPERATIONS_PER_POLL`].
///
/// Always `true` outside of LUNA processes: other runtimes have their own means.
#[inline]
pub fn count_operation() -> bool {
    spend_operation() || is_replayed()
}

/// As [`count_operation`], but also `false` in a replayed process that has used up its operations:
/// for callers that then ask whether the process may go on.
#[inline]
pub fn spend_operation() -> bool {
    THREAD.with(|thread| {
        if thread.process.get().is_none() {
            return true;
        }
        let left = thread.operations_left.get();
        thread.operations_left.set(left.saturating_sub(1));
        left != 0
    })
}
