//! The current process: the contract between channels and executors.
//!
//! Code that polls processes sets a thread-local *current process* around each poll. Code that
//! makes processes wait (channels, barriers, timers) reads it: to order wait lists by priority, and
//! to ready a process without its waker ([`WakeHandle`]). On a thread that runs no LUNA process (a
//! plain thread, tokio, smol) it is absent: the priority is then the lowest, and wakes use the
//! waker.

pub(crate) mod branch;
mod branches;
mod cpu;
mod executor_thread;
pub(crate) mod inheritance;
pub(crate) mod inheritor;
mod ready;
mod renewal;
pub(crate) mod run_queue;
pub(crate) mod turn;
mod wake_handle;

pub use branch::{
    branch_failed, branch_path, end_branch, has_replay_log, in_branch, is_replayed, replay_log,
    stay_in_branch, take_branch_end, with_branch_below, with_replay_log, without_replay_log,
};
pub use branches::Branches;
#[cfg(not(loom))]
pub(crate) use cpu::with_processes;
pub use cpu::{Cpu, ask_look, enter_executor, timers};
pub(crate) use cpu::{give_back_timers, has_no_deadline_within, has_other_timers};
#[cfg(all(feature = "std", not(loom)))]
pub use executor_thread::refused_boosts;
pub use inheritor::Inheritor;
pub use ready::{
    OPERATIONS_PER_POLL, count_operation, is_outranked, next_ready, put_back, ready_again,
    ready_levels, spend_operation, yield_if_outranked, yield_turn,
};
pub use renewal::Renewal;
pub use turn::{
    Here, PlainTurn, Turn, end_turns, give_turn, outside, plain_turn, priority, process,
    take_interrupted, user, with_process,
};
pub use wake_handle::{PendingWake, PlainPendingWake, WakeHandle};

#[cfg(not(loom))]
pub use crate::process::Alone;
pub use crate::process::{
    AfterTurn, ExecutorId, LEVELS, Methods, Priority, Process, ProcessId, ProcessState, QueueEnd,
    User, fail_current,
};
pub(crate) use ready::{unqueue, with_queue};

use crate::model_local::model_local;
use crate::path;
use crate::replay_log::ReplayLog;
use branch::{Branch, lowered};
use core::cell::Cell;
use core::ptr::NonNull;
use core::task::Waker;
use luna_platform::on_drop::OnDrop;
use run_queue::RunQueue;

/// The state of a thread that runs processes.
///
/// The fields of each turn and each operation come first, at the beginning of a cache line: so they
/// share one, whatever other thread-locals a program has.
#[repr(C, align(64))]
pub(crate) struct Thread {
    /// The process that is polled, or was polled last: see [`end_turns`].
    pub(crate) process: Cell<Option<NonNull<Process>>>,
    /// Where the waker of that process lies, while its turn is a [plain](plain_turn) one.
    pub(crate) plain: Cell<*const Waker>,
    pub(crate) branch: Cell<Branch>,
    executor_id: Cell<Option<ExecutorId>>,
    operations_left: Cell<u32>,
    /// What the thread writes into the locks that it is inside of.
    thread_id: Cell<u32>,
    branch_ended: Cell<bool>,
    may_block: Cell<bool>,
    on_path: Cell<bool>,
    abandons: Cell<bool>,
    poisons: Cell<bool>,
    gives_up: Cell<bool>,
    pub(crate) queue: RunQueue,
    replay_log: Cell<Option<NonNull<dyn ReplayLog>>>,
}

model_local! {
    static THREAD: Thread = const {
        Thread {
            process: Cell::new(None),
            plain: Cell::new(core::ptr::null()),
            executor_id: Cell::new(None),
            queue: RunQueue::new(),
            operations_left: Cell::new(0),
            thread_id: Cell::new(0),
            branch: Cell::new(Branch::WHOLE),
            branch_ended: Cell::new(false),
            may_block: Cell::new(true),
            on_path: Cell::new(false),
            abandons: Cell::new(false),
            poisons: Cell::new(false),
            gives_up: Cell::new(false),
            replay_log: Cell::new(None),
        }
    };
}

/// The state of the calling thread. It does not leave the thread: it is not `Sync`.
///
/// Hot paths use this rather than a closure, which the compiler may leave as a call.
#[inline(always)]
pub(crate) fn local<'a>() -> &'a Thread {
    // SAFETY: the state has no destructor, so it is there as long as the thread runs.
    THREAD.with(|thread| unsafe { &*core::ptr::from_ref(thread) })
}

impl Thread {
    /// Sets the current process and the branch of it that is polled. Returns the former ones.
    fn exchange_turn(
        &self,
        process: Option<NonNull<Process>>,
        branch: Branch,
    ) -> (Option<NonNull<Process>>, Branch) {
        let before = self.process.replace(process);
        (before, self.exchange_branch(branch))
    }

    /// Sets the branch of the current process that is polled. Returns the former one.
    #[inline]
    fn exchange_branch(&self, branch: Branch) -> Branch {
        let before = self.branch.replace(branch);
        let process = self.process.get().filter(|_| branch.is_plain());
        // SAFETY: the pointer is that of a process which is being polled, so it is live.
        let waker = process.and_then(|process| unsafe { process.as_ref() }.waker_of_plain_turns());
        self.plain.set(waker.unwrap_or(core::ptr::null()));
        before
    }
}

/// The turn of `process` is not a plain one any more, if it has it.
pub(crate) fn not_plain(process: &Process) {
    let thread = local();
    if thread.process.get() == Some(NonNull::from(process)) {
        thread.plain.set(core::ptr::null());
    }
}

/// The executor of this thread, if it runs processes.
#[inline]
pub fn executor_id() -> Option<ExecutorId> {
    THREAD.with(|thread| thread.executor_id.get())
}

/// The id of this thread's executor; 0 if it runs no processes.
///
/// There are three values for "no executor": 0 here, for a plain thread; `u64::MAX` for a
/// [biased lock](crate::biased_lock) without a bias; and, for a process without an executor, an id
/// of its own that no thread has ([`Process::executor_number`]).
#[inline(always)]
pub(crate) fn executor_number() -> u64 {
    THREAD.with(|thread| thread.executor_id.get().map_or(0, ExecutorId::number))
}

/// Whether a blocking call on this thread delays no other process: not on an executor's thread.
pub fn may_block() -> bool {
    THREAD.with(|thread| thread.may_block.get())
}

/// Calls `f`, which drops a process' body, or a branch of it, before its end: it was cancelled, a
/// sibling has failed, or it panicked. Destructors see by [`is_abandoned`] that they run in the
/// middle of the body.
pub fn with_abandoned<R>(f: impl FnOnce() -> R) -> R {
    with_flag(|thread| &thread.abandons, f)
}

/// Whether the body or branch that is being dropped has not come to its end.
#[inline]
pub fn is_abandoned() -> bool {
    has_flag(|thread| &thread.abandons)
}

/// Runs `drop`. Meanwhile every channel end that is dropped on this thread poisons its channel,
/// instead of merely counting as one less: the partners of a failed process must learn that what
/// they wait for will not come.
pub fn poison_dropped_ends<R>(drop: impl FnOnce() -> R) -> R {
    with_flag(|thread| &thread.poisons, drop)
}

/// Whether a channel end that is dropped here and now poisons its channel.
#[inline]
pub fn dropped_ends_poison() -> bool {
    has_flag(|thread| &thread.poisons)
}

/// Drops bodies by `drop`, since the thread has panicked outside of any process.
#[cfg(not(loom))]
pub(crate) fn give_up(drop: impl FnOnce()) {
    with_flag(|thread| &thread.gives_up, drop);
}

/// Whether the bodies that are dropped on this thread now are dropped because their executor's
/// thread panicked outside of any process: in a waker that is not LUNA's, for example.
#[cfg(not(loom))]
#[inline]
pub fn has_given_up() -> bool {
    has_flag(|thread| &thread.gives_up)
}

#[inline(always)]
fn with_flag<R>(flag: fn(&Thread) -> &Cell<bool>, f: impl FnOnce() -> R) -> R {
    let before = THREAD.with(|thread| flag(thread).replace(true));
    let _restore = OnDrop::new(|| THREAD.with(|thread| flag(thread).set(before)));
    f()
}

/// `false` also while the thread's locals are being torn down, which may drop channel ends.
#[inline(always)]
fn has_flag(flag: fn(&Thread) -> &Cell<bool>) -> bool {
    THREAD
        .try_with(|thread| flag(thread).get())
        .unwrap_or(false)
}

/// Whether this thread is on the real-time path: it runs the bodies of processes, or schedules
/// them. Without `std`, an interrupt always is, so that it defers what it frees.
#[inline]
pub fn on_path() -> bool {
    #[cfg(not(feature = "std"))]
    if luna_platform::bare::is_interrupt() {
        return true;
    }
    // An allocator calls this too, also while the thread's locals are being torn down.
    has_flag(|thread| &thread.on_path)
}

/// Sets whether this thread is on the real-time path; returns the previous value.
#[inline]
pub fn set_on_path(on_path: bool) -> bool {
    // The path watcher is notified while the thread counts as off the path.
    let before = THREAD.with(|thread| thread.on_path.replace(false));
    path::switched(on_path);
    THREAD.with(|thread| thread.on_path.set(on_path));
    before
}

#[cfg(all(test, not(loom)))]
mod tests;
