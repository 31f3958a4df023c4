//! The branch of the current process that is being polled, and the process' replay log.

use super::{LEVELS, QueueEnd, THREAD, local, ready_again};
use crate::replay_log::ReplayLog;
use core::ptr::NonNull;
use core::task::Context;
use luna_platform::on_drop::OnDrop;

/// The branch of the current process that is being polled. The highest bit of the low byte says
/// that a sibling has failed; the lowest six bits are the number of levels below its process; the
/// bit between says that it is a branch and not the whole process. Above them, a bit says that the
/// process has a [replay log](crate::replay_log); if it has, the upper half is the number of the
/// branch. One word, since it is saved and restored around each poll.
#[derive(Clone, Copy)]
pub(crate) struct Branch(pub(super) u64);

impl Branch {
    /// No branch, but the process itself.
    pub(super) const WHOLE: Branch = Branch(0);
    const FAILED: u64 = 1 << 7;
    const PART: u64 = 1 << 6;
    pub(super) const HAS_LOG: u64 = 1 << 8;

    /// Whether it runs at its process' level, and no sibling has failed: it may be a branch.
    #[inline]
    pub(super) fn is_plain(self) -> bool {
        self.0 & !Self::PART == 0
    }

    /// Whether it is no branch, but the process itself, without a replay log.
    #[inline]
    pub(crate) fn is_whole(self) -> bool {
        self.0 == Self::WHOLE.0
    }

    #[inline]
    pub(super) fn has_failed(self) -> bool {
        self.0 & Self::FAILED != 0
    }

    #[inline]
    pub(super) fn lowered(self) -> u8 {
        (self.0 & 0x3f) as u8
    }

    #[inline]
    pub(super) fn has_replay_log(self) -> bool {
        self.0 & Self::HAS_LOG != 0
    }

    /// The path of parallel constructs down to it, as a number; 0 is the process itself.
    #[inline]
    pub(super) fn path(self) -> u32 {
        (self.0 >> 32) as u32
    }

    /// A branch of this one.
    #[inline]
    pub(super) fn branch(self, failed: bool, levels: u8, number: u32) -> Branch {
        // Clamped to the number of levels, to stay clear of the other bits.
        let lowered = (self.lowered() + levels.min(LEVELS)).min(LEVELS - 1);
        let mut branch = Branch(
            self.0 & Self::FAILED | u64::from(failed) << 7 | Self::PART | u64::from(lowered),
        );
        if self.has_replay_log() {
            branch.0 |= Self::HAS_LOG | u64::from(self.path_of(number)) << 32;
        }
        branch
    }

    /// The path of branch `number` of this one.
    #[cold]
    pub(super) fn path_of(self, number: u32) -> u32 {
        // FNV-1a by words: different enough for the few paths of a process.
        ((self.path() ^ 0x811c_9dc5).wrapping_mul(0x0100_0193) ^ (number + 1))
            .wrapping_mul(0x0100_0193)
            .max(1)
    }
}

/// The number of levels that the current branch runs below its process.
#[inline]
pub(super) fn lowered() -> u8 {
    THREAD.with(|thread| thread.branch.get().lowered())
}

/// Whether a branch is being polled, which has siblings that may be ready.
#[inline]
pub fn in_branch() -> bool {
    THREAD.with(|thread| thread.branch.get().0 & Branch::PART != 0)
}

/// Whether a sibling of the current branch has failed, so that its operations fail as poisoned.
#[inline]
pub fn branch_failed() -> bool {
    THREAD.with(|thread| thread.branch.get().has_failed())
}

/// Ends the current branch, a sibling of which has failed: for an operation that cannot go on, and
/// has no error to return. The caller returns `Pending`. The construct drops the branch where it
/// waits, unless another of the branch's operations has an error to return in the same poll
/// ([`stay_in_branch`]). In case that changes nothing, the branch is polled once more.
pub fn end_branch(cx: &Context<'_>) {
    THREAD.with(|thread| thread.branch_ended.set(true));
    ready_again(cx, QueueEnd::Back);
}

/// Reverts [`end_branch`]: an operation returns the error to the branch, which may then clean up.
#[inline]
pub fn stay_in_branch() {
    THREAD.with(|thread| thread.branch_ended.set(false));
}

/// Whether the branch that was just polled is to be dropped. Its construct calls this after each
/// poll with a known failure.
#[inline]
pub fn take_branch_end() -> bool {
    THREAD.with(|thread| thread.branch_ended.replace(false))
}

/// Polls a branch of a parallel construct, `levels` below its parent, but not below level 0. Its
/// operations wait at that level, and their wakes queue the process there. In nested constructs the
/// levels add up. `failed`: a sibling has failed, which reaches nested constructs too. `number`
/// distinguishes the branch from its siblings.
#[inline]
pub fn with_branch_below<R>(failed: bool, levels: u8, number: u32, poll: impl FnOnce() -> R) -> R {
    let thread = local();
    let before = thread.branch.get();
    // The turn stays as plain as it is.
    let is_plain = before.is_plain() && !failed && levels == 0;
    match is_plain {
        true => thread.branch.set(Branch(Branch::PART)),
        false => {
            thread.exchange_branch(before.branch(failed, levels, number));
        }
    }
    let _restore = OnDrop::new(|| match is_plain {
        true => local().branch.set(before),
        false => {
            local().exchange_branch(before);
        }
    });
    poll()
}

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
