//! Whether the current process is recorded or replayed, and its replay log.

use super::THREAD;
use super::branch::Branch;
use crate::replay_log::ReplayLog;
use std::ptr::NonNull;

/// Polls the current process as one with the replay log `tape`: it has no [plain
/// turns](super::plain_turn), and all its operations find the log.
pub fn with_tape<R>(tape: &dyn ReplayLog, poll: impl FnOnce() -> R) -> R {
    struct Restore(Branch, Option<NonNull<dyn ReplayLog>>);
    impl Drop for Restore {
        fn drop(&mut self) {
            THREAD.with(|thread| {
                thread.set_branch(self.0);
                thread.tape.set(self.1);
            });
        }
    }
    let is_replay = tape.is_replay();
    let tape: *const (dyn ReplayLog + '_) = tape;
    // SAFETY: the same pointer; it is removed before its borrow ends, and `tape` passes it on for
    // no longer than a call.
    let tape: *mut (dyn ReplayLog + 'static) = unsafe { std::mem::transmute(tape) };
    let _restore = THREAD.with(|thread| {
        let branch = thread.branch.get();
        thread.set_branch(Branch(branch.0 | Branch::TAPED));
        if is_replay {
            // So that each operation that need not wait asks whether its process may go on.
            thread.operations_left.set(0);
        }
        Restore(branch, thread.tape.replace(NonNull::new(tape)))
    });
    poll()
}

/// Calls `f` as if the current process had no replay log: for work within one of its operations.
pub fn without_tape<R>(f: impl FnOnce() -> R) -> R {
    struct Restore(Branch);
    impl Drop for Restore {
        fn drop(&mut self) {
            THREAD.with(|thread| thread.set_branch(self.0));
        }
    }
    let _restore = THREAD.with(|thread| {
        let branch = thread.branch.get();
        thread.set_branch(Branch(branch.0 & !Branch::TAPED));
        Restore(branch)
    });
    f()
}

/// Whether the current process has a replay log.
#[inline]
pub fn is_taped() -> bool {
    THREAD.with(|thread| thread.branch.get().is_taped())
}

/// Whether the current process is replayed.
#[cold]
pub fn is_replayed() -> bool {
    tape(|tape| tape.is_replay()).unwrap_or_default()
}

/// Calls `f` with the current process' replay log, if it has one.
pub fn tape<R>(f: impl FnOnce(&dyn ReplayLog) -> R) -> Option<R> {
    is_taped().then(|| {
        let tape = THREAD.with(|thread| thread.tape.get())?;
        // SAFETY: `with_tape` sets it from a reference that lives until it is removed, and the
        // closure cannot keep the reference.
        Some(f(unsafe { tape.as_ref() }))
    })?
}

/// The branch of the current process that is being polled, if it has a replay log: a number of the
/// path down to it; 0 is the process itself.
pub fn branch_path() -> u32 {
    THREAD.with(|thread| thread.branch.get().path())
}
