//! Whether the current process is recorded or replayed, and its replay log.

use super::THREAD;
use super::branch::Branch;
use crate::replay_log::ReplayLog;
use core::ptr::NonNull;
use luna_platform::on_drop::OnDrop;

/// Polls the current process as one with the replay log `log`: it has no [plain
/// turns](super::plain_turn), and all its operations find the log.
pub fn with_replay_log<R>(log: &dyn ReplayLog, poll: impl FnOnce() -> R) -> R {
    let is_replay = log.is_replay();
    let log: *const (dyn ReplayLog + '_) = log;
    // SAFETY: the same pointer; it is removed before its borrow ends, and `replay_log` passes it on
    // for no longer than a call.
    let log: *mut (dyn ReplayLog + 'static) = unsafe { core::mem::transmute(log) };
    let before = THREAD.with(|thread| {
        let branch = Branch(thread.branch.get().0 | Branch::HAS_LOG);
        let branch = thread.exchange_branch(branch);
        if is_replay {
            // So that each operation that need not wait asks whether its process may go on.
            thread.operations_left.set(0);
        }
        (branch, thread.replay_log.replace(NonNull::new(log)))
    });
    let _restore = OnDrop::new(|| {
        THREAD.with(|thread| {
            thread.exchange_branch(before.0);
            thread.replay_log.set(before.1);
        });
    });
    poll()
}

/// Calls `f` as if the current process had no replay log: for work within one of its operations.
#[inline]
pub fn without_replay_log<R>(f: impl FnOnce() -> R) -> R {
    if !has_replay_log() {
        return f();
    }
    let before = THREAD.with(|thread| {
        let branch = Branch(thread.branch.get().0 & !Branch::HAS_LOG);
        thread.exchange_branch(branch)
    });
    let _restore = OnDrop::new(|| {
        THREAD.with(|thread| thread.exchange_branch(before));
    });
    f()
}

/// Whether the current process has a replay log.
#[inline]
pub fn has_replay_log() -> bool {
    THREAD.with(|thread| thread.branch.get().has_replay_log())
}

/// Whether the current process is replayed.
#[cold]
pub fn is_replayed() -> bool {
    replay_log(|log| log.is_replay()).unwrap_or_default()
}

/// Calls `f` with the current process' replay log, if it has one.
pub fn replay_log<R>(f: impl FnOnce(&dyn ReplayLog) -> R) -> Option<R> {
    has_replay_log().then(|| {
        let log = THREAD.with(|thread| thread.replay_log.get())?;
        // SAFETY: `with_replay_log` sets it from a reference that lives until it is removed, and
        // the closure cannot keep the reference.
        Some(f(unsafe { log.as_ref() }))
    })?
}

/// The branch of the current process that is being polled, if it has a replay log: a number of the
/// path down to it; 0 is the process itself.
pub fn branch_path() -> u32 {
    THREAD.with(|thread| thread.branch.get().path())
}
