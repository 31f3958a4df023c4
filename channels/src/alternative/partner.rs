//! What the partner of an alternative does, in a plain turn.

use crate::select_state::SelectState;
use core::ptr::NonNull;
use luna_core::current::{PlainPendingWake, PlainTurn};

/// Result of a partner's attempt to commit the alternative of a guard.
pub(crate) enum Commit {
    /// It has chosen this guard. The caller takes the guard off and settles it.
    Chosen(PlainPendingWake),
    /// It has chosen another one. The caller takes the guard off, and settles it as stale.
    Stale,
    /// Not to be done on the fast path.
    No,
}

/// Commits an alternative through this guard of it.
///
/// # Safety
///
/// The guard waits at a wait point in whose lock this thread is: so the select state is live.
#[inline(always)]
pub(crate) unsafe fn commit(
    (select_state, guard): (NonNull<SelectState>, u32),
    turn: PlainTurn<'_>,
) -> Commit {
    // SAFETY: the guard waits, and its owner needs the wait point's lock, which is held, to
    // withdraw it: so its select state is live. No thread holds a commit lock across a poll, and
    // this one has not entered it yet. Then this is a partner in the commit lock, by its bias.
    unsafe {
        let select_state = select_state.as_ref();
        if !select_state.is_open() {
            return Commit::Stale;
        }
        // The commit lock of a select state that the fast path has opened is biased too.
        let Some(mut opening) = select_state.commit_lock_if_biased(turn.here()) else {
            return Commit::No;
        };
        match select_state.commit_plainly(&mut opening, guard) {
            Some(ready) => Commit::Chosen(ready),
            None => Commit::No,
        }
    }
}
