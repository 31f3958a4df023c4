//! A guard of an alternative that waits alone for an operation: it is committed first.

use super::{FastPath, depart, give, move_value, wait_alone};
use crate::alternative::{Commit, commit};
use crate::select_state::{Opening, SelectState};
use crate::wait_point::{WaitPoint, WaitQueues};
use crate::waiter::Waiter;
use core::ptr::NonNull;
use luna_core::biased_lock::{InsideGuard, Refused};
use luna_core::current::{PlainPendingWake, PlainTurn};
use luna_core::wait_list::WaitNode;

/// As [`meet`](super::meet), where a guard waits alone for an operation of this side. The lock was
/// kept. Rare cases are left to functions that are called last, so that no register is saved for
/// them.
///
/// # Safety
///
/// As for [`meet`](super::meet); the lock was kept, and `guard` waits alone for an operation of
/// this side.
#[inline(never)]
pub(super) unsafe fn meet_guard<const SEND: bool>(
    wait_point: &WaitPoint,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
    guard: NonNull<WaitNode>,
) -> FastPath {
    // SAFETY: the lock was kept, and is taken back once. A guard that waits alone was begun with
    // its select state, which is live while the lock is held: the owner needs it to withdraw the
    // guard. If the select state is left, the guard is stale, and `wait_alone` overwrites its note.
    // Its partner commits it under the commit lock, which no thread holds across a poll, and which
    // this one enters once, by its bias. Until it is settled it is a waiting operation of the
    // channel: its value can be moved as in `meet`.
    unsafe {
        let mut lists = wait_point.kept(turn);
        // In a model every value is moved here.
        if !lists.moves_word && cfg!(not(loom)) {
            lists.keep();
            return meet_guard_long::<SEND>(wait_point, node, turn, guard);
        }
        let (select_state, number) = Waiter::<()>::guard_of(guard.cast());
        let select_state = select_state.as_ref();
        if !select_state.is_open() {
            Waiter::<()>::settle_stale(guard.cast());
            return wait_alone::<SEND>(wait_point, lists, node, turn);
        }
        let mut commit_lock = match select_state.enter_commit_lock(turn) {
            Ok(commit_lock) => commit_lock,
            Err(refused) => return guard_refuses(lists, select_state, refused),
        };
        let Some(ready) = select_state.commit_plainly(&mut commit_lock, number) else {
            return not_committed(lists, select_state, commit_lock);
        };
        lists.set_nothing_waits();
        if !commit_lock.leave() {
            lists.keep();
            return give_revoked::<SEND>(wait_point, node, turn, guard, ready);
        }
        let (from, to) = match SEND {
            true => (node, guard.cast()),
            false => (guard.cast(), node),
        };
        match cfg!(loom) {
            true => move_value(wait_point, from, to),
            false => Waiter::move_word(from, to),
        }
        depart::<SEND>(wait_point, lists, (guard, ready), turn)
    }
}

/// As [`meet_guard`], for a value that is longer than a word.
///
/// # Safety
///
/// As for [`meet_guard`]: the lock was kept, and `guard` waits alone for an operation of this side.
#[inline(never)]
unsafe fn meet_guard_long<const SEND: bool>(
    wait_point: &WaitPoint,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
    guard: NonNull<WaitNode>,
) -> FastPath {
    // SAFETY: the lock was kept, and is taken back once. A guard that waits alone was begun with
    // its select state, and no other thread can withdraw it under the lock: so `commit` finds that
    // live. A stale guard is settled before `wait_alone` overwrites its note; a chosen one is taken
    // off for `give`.
    unsafe {
        let mut lists = wait_point.kept(turn);
        match commit(Waiter::<()>::guard_of(guard.cast()), turn) {
            Commit::Chosen(ready) => {
                lists.set_nothing_waits();
                give::<SEND>(wait_point, lists, node, (guard, ready), turn)
            }
            Commit::Stale => {
                Waiter::<()>::settle_stale(guard.cast());
                wait_alone::<SEND>(wait_point, lists, node, turn)
            }
            Commit::No => FastPath::No,
        }
    }
}

/// The alternative of a guard cannot be committed on the fast path.
#[cold]
#[inline(never)]
pub(in crate::core) fn guard_refuses(
    lists: InsideGuard<'_, WaitQueues>,
    select_state: &SelectState,
    refused: Refused,
) -> FastPath {
    if refused == Refused::Revoked {
        select_state.after_revocation();
    }
    drop(lists);
    FastPath::No
}

/// As [`guard_refuses`], in the commit lock. Inlined: a guard that is an argument has to lie in
/// memory all the time before.
#[inline(always)]
pub(in crate::core) fn not_committed(
    lists: InsideGuard<'_, WaitQueues>,
    select_state: &SelectState,
    commit_lock: InsideGuard<'_, Opening>,
) -> FastPath {
    let refused = match commit_lock.leave() {
        true => Refused::NotBiased,
        false => Refused::Revoked,
    };
    guard_refuses(lists, select_state, refused)
}

/// As the rest of [`meet_guard`], where the bias of the commit lock was revoked meanwhile. The lock
/// of the wait point was kept.
///
/// # Safety
///
/// As for [`meet`](super::meet); the lock was kept. The alternative was committed through this
/// guard, which is noted nowhere any more, or through this entry of a registered one; it is not
/// settled. `ready` is its wake.
#[cold]
#[inline(never)]
pub(in crate::core) unsafe fn give_revoked<const SEND: bool>(
    wait_point: &WaitPoint,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
    guard: NonNull<WaitNode>,
    ready: PlainPendingWake,
) -> FastPath {
    // SAFETY: the owner needs the lock of the wait point, which was kept, before it can withdraw
    // the guard or free it: so its select state is live until the guard is settled. The lock is
    // taken back once, and the guard was committed and taken off, as `give` demands.
    unsafe {
        let (select_state, _) = Waiter::<()>::guard_of(guard.cast());
        select_state.as_ref().after_revocation();
        let lists = wait_point.kept(turn);
        give::<SEND>(wait_point, lists, node, (guard, ready), turn)
    }
}
