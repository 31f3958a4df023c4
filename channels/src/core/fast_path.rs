//! Communication between two processes of one executor by sends, receives and guards of
//! alternatives: nearly every communication.
//!
//! It gives the same results as [`ChannelGuard`](super::ChannelGuard), without branches for what is
//! not there: the lock is biased to the executor, so it is taken and left by plain stores; no waker
//! is cloned or called; at most one alternative is registered, no call is served, no buffer
//! overwrites; the process is neither recorded nor has a replay log. Whenever one of these
//! conditions does not hold, no value has moved, and the operation takes the slow path.
//!
//! ```text
//!   plain turn? --> lock biased to this executor? --> what waits, one word?
//!      | no              | no                           | nothing: the node waits alone
//!      '--> slow path <--'                              | a partner alone: move, leave, ready it
//!                ^                                      | a guard alone: commit it, then as above
//!                |                                      | a registered alternative: as a guard
//!                |                                      | a buffer: store or take a value
//!                '--------------------------------------' anything else
//! ```
//!
//! A node that waits alone belongs to a process of this very executor: only the executor that owns
//! the bias lets a node wait so, and a lock is biased to no second one.
//!
//! [`meet`] does not depend on the type of the values, so all channels share one copy of it for
//! each direction. A system has processes of many kinds, and its channels many types: with a copy
//! for each, the code of a cycle exceeds the first-level cache, and a loop that sleeps between its
//! cycles waits for its code more than it computes (docs/performance.md, "After a sleep").

use super::Channel;
use crate::alternative::{Commit, commit, take_first};
use crate::select_state::SelectState;
use crate::wait_point::{LastUser, WaitPoint, WaitQueues, Waiting};
use crate::waiter::Waiter;
use luna_core::biased_lock::{InsideGuard, Refused};
use luna_core::current::{PlainPendingWake, PlainTurn};
use luna_core::wait_list::WaitNode;
use std::hint::black_box;
use std::ptr::NonNull;

/// Result of an operation on the fast path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FastPath {
    /// It is done, and the partner is ready.
    Done,
    /// The node waits.
    Waits,
    /// It is done, and the process is queued again: others run first.
    GaveWay,
    /// Fast path unavailable: no value has moved, and the operation is as new. Take the slow path.
    /// Stale guards of alternatives may have been taken off.
    No,
}

/// A step of the fast path that depends on the type of the channel's values: the rest of [`meet`]
/// where its condition holds. The lock was kept.
///
/// # Safety
///
/// As for `meet`, with the wait point of such a channel.
pub(crate) type Meet =
    unsafe fn(NonNull<WaitPoint>, NonNull<Waiter<()>>, PlainTurn<'_>) -> FastPath;

impl FastPath {
    /// Of an operation that is done.
    #[inline(always)]
    pub(super) fn done(turn: PlainTurn<'_>) -> FastPath {
        match turn.yields_after_operation() {
            true => FastPath::GaveWay,
            false => FastPath::Done,
        }
    }
}

/// Meets the partner that waits alone, or lets the operation wait. O(1).
///
/// # Safety
///
/// `node` is that of an operation of the channel around `wait_point`, a send if `SEND`, and not
/// listed. A send's holds its value, and a receive's none. No other thread accesses it, and it
/// stays where it is until it is settled or withdrawn. `channel` is a pointer to the whole channel.
#[inline(always)]
unsafe fn meet<const SEND: bool>(
    channel: NonNull<WaitPoint>,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the contract; the operation keeps its channel.
    let wait_point = unsafe { channel.as_ref() };
    // SAFETY: a plain turn's poll begins without a lock of a wait point, on this thread. The
    // closure of a `send_with` runs under one, but it has no plain turn.
    let lists = match unsafe { wait_point.enter(turn) } {
        Ok(lists) => lists,
        Err(Refused::NotBiased) => return FastPath::No,
        Err(Refused::Revoked) => return revoked(wait_point, FastPath::No),
    };
    // SAFETY: the contract. The lock is held: a node that waits alone is live, and belongs to a
    // process of this executor.
    unsafe {
        if let Some(partner) = lists.waiting.one(!SEND) {
            if !lists.moves_word {
                lists.keep();
                return part_long::<SEND>(wait_point, node, turn, partner);
            }
            let (from, to) = match SEND {
                true => (node, partner.cast()),
                false => (partner.cast(), node),
            };
            Waiter::move_word(from, to);
            return part::<SEND>(wait_point, lists, partner, turn);
        }
        if lists.waiting.is_idle() {
            return wait_alone::<SEND>(wait_point, lists, node, turn);
        }
        let waiting = lists.waiting;
        lists.keep();
        if waiting.is_store() {
            return meet_store::<SEND>(channel, node, turn);
        }
        if SEND && waiting == Waiting::REGISTERED {
            return (wait_point.identity.values.send_to_registered)(channel, node, turn);
        }
        match waiting.guard(!SEND) {
            Some(guard) => meet_guard::<SEND>(wait_point, node, turn, guard),
            None => meet_otherwise::<SEND>(channel, node, turn),
        }
    }
}

/// As the rest of [`meet`], at a channel with a buffer.
///
/// # Safety
///
/// As there. The lock was kept.
#[inline(always)]
unsafe fn meet_store<const SEND: bool>(
    channel: NonNull<WaitPoint>,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the contract.
    unsafe {
        let values = channel.as_ref().identity.values;
        match SEND {
            true => (values.store)(channel, node, turn),
            false => (values.take)(channel, node, turn),
        }
    }
}

/// Lets the operation wait alone.
///
/// # Safety
///
/// As for [`meet`]; the lists are those of `wait_point`, where nothing waits.
#[inline(always)]
pub(super) unsafe fn wait_alone<const SEND: bool>(
    wait_point: &WaitPoint,
    mut lists: InsideGuard<'_, WaitQueues>,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // Read before the stores: the process is read once then.
    let user = LastUser::process(turn.process().id());
    // SAFETY: the contract.
    unsafe { Waiter::begin_alone(node, turn) };
    lists.note_user(SEND, user);
    lists.set_alone(node.cast(), SEND);
    if !lists.leave() {
        return revoked(wait_point, FastPath::Waits);
    }
    FastPath::Waits
}

/// Lets the partner go after the value was moved: it is ready from here on.
///
/// # Safety
///
/// The lists are those of `wait_point`. The partner waits alone there: this executor has begun its
/// node by [`Waiter::begin_alone`].
#[inline(always)]
unsafe fn part<const SEND: bool>(
    wait_point: &WaitPoint,
    mut lists: InsideGuard<'_, WaitQueues>,
    partner: NonNull<WaitNode>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: by the contract the partner's wake handle was made on this thread, and no other
    // thread has taken it, since the lock is held.
    unsafe {
        let ready = WaitNode::take_alone(partner.as_ptr());
        lists.set_nothing_waits();
        depart::<SEND>(wait_point, lists, (partner, ready), turn)
    }
}

/// As the rest of [`part`], for a partner that was taken off.
///
/// # Safety
///
/// The lists are those of `wait_point`. The partner's node is listed nowhere and not settled.
/// `ready` is its wake, made in a plain turn on this thread.
#[inline(always)]
pub(super) unsafe fn depart<const SEND: bool>(
    wait_point: &WaitPoint,
    mut lists: InsideGuard<'_, WaitQueues>,
    (partner, ready): (NonNull<WaitNode>, PlainPendingWake),
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the contract.
    unsafe {
        lists.note_user(SEND, LastUser::process(turn.process().id()));
        Waiter::<()>::settle_plain(partner.cast());
        if !lists.leave() {
            return part_revoked(wait_point, ready, turn);
        }
        wake_partner(ready, turn)
    }
}

/// Readies the partner of an operation that is done, and yields if another process is to run first.
///
/// # Safety
///
/// The wake handle was made in a plain turn on this thread, which holds no lock.
#[inline(always)]
pub(crate) unsafe fn wake_partner(ready: PlainPendingWake, turn: PlainTurn<'_>) -> FastPath {
    // SAFETY: the contract.
    unsafe {
        match ready.wake_if_none_ready(turn) {
            Ok(()) => FastPath::Done,
            Err(ready) => wake_otherwise(ready, turn),
        }
    }
}

/// As the rest of [`meet`], for a value that is longer than a word. The lock was kept. The
/// arguments are in the order of `meet`, so that none is moved between registers.
///
/// # Safety
///
/// As there; `partner` waits alone for an operation of this side.
#[inline(never)]
unsafe fn part_long<const SEND: bool>(
    wait_point: &WaitPoint,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
    partner: NonNull<WaitNode>,
) -> FastPath {
    let (from, to) = match SEND {
        true => (node, partner.cast()),
        false => (partner.cast(), node),
    };
    // SAFETY: the contract.
    unsafe {
        move_value(wait_point, from, to);
        let lists = wait_point.kept(turn);
        part::<SEND>(wait_point, lists, partner, turn)
    }
}

/// Moves a value of any type between two nodes.
///
/// # Safety
///
/// As for [`Mover`](crate::wait_point::Mover), of nodes of the channel around `wait_point`.
#[inline(always)]
unsafe fn move_value(wait_point: &WaitPoint, from: NonNull<Waiter<()>>, to: NonNull<Waiter<()>>) {
    // SAFETY: the contract; a wait point has the methods of its channel's values.
    unsafe {
        match wait_point.identity.values.mover {
            Some(mover) => mover(from, to),
            None => Waiter::move_word(from, to),
        }
    }
}

/// The owner has left, and found the bias revoked.
#[cold]
#[inline(never)]
fn revoked(wait_point: &WaitPoint, result: FastPath) -> FastPath {
    wait_point.after_revocation();
    // Not to be seen through: a known result would be set after a call, which then is no tail call.
    black_box(result)
}

/// As the rest of [`part`].
///
/// # Safety
///
/// As there.
#[cold]
#[inline(never)]
unsafe fn part_revoked(
    wait_point: &WaitPoint,
    ready: PlainPendingWake,
    turn: PlainTurn<'_>,
) -> FastPath {
    wait_point.after_revocation();
    // SAFETY: the contract.
    unsafe { wake_otherwise(ready, turn) }
}

/// Readies the partner, whatever is ready already.
///
/// # Safety
///
/// As for [`part`].
#[inline(never)]
unsafe fn wake_otherwise(ready: PlainPendingWake, turn: PlainTurn<'_>) -> FastPath {
    // SAFETY: the contract.
    unsafe {
        ready.fetch();
        ready.wake();
        FastPath::done(turn)
    }
}

/// As [`meet`], where a guard waits alone for an operation of this side. The lock was kept. Rare
/// cases are left to functions that are called last, so that no register is saved for them.
///
/// # Safety
///
/// As there, and for [`part_long`].
#[inline(never)]
unsafe fn meet_guard<const SEND: bool>(
    wait_point: &WaitPoint,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
    guard: NonNull<WaitNode>,
) -> FastPath {
    // SAFETY: the contract; the lock was kept, and a guard that waits alone was begun as one.
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
        let commit_lock = match select_state.enter_commit_lock(turn) {
            Ok(commit_lock) => commit_lock,
            Err(refused) => return guard_refuses(lists, select_state, Err(refused)),
        };
        let Some(ready) = select_state.commit_plainly(number) else {
            return guard_refuses(lists, select_state, Ok(commit_lock));
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
/// As there.
#[inline(never)]
unsafe fn meet_guard_long<const SEND: bool>(
    wait_point: &WaitPoint,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
    guard: NonNull<WaitNode>,
) -> FastPath {
    // SAFETY: the contract, as there.
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
pub(super) fn guard_refuses(
    lists: InsideGuard<'_, WaitQueues>,
    select_state: &SelectState,
    commit_lock: Result<InsideGuard<'_, ()>, Refused>,
) -> FastPath {
    match commit_lock {
        Ok(commit_lock) => drop(commit_lock),
        Err(Refused::Revoked) => select_state.after_revocation(),
        Err(Refused::NotBiased) => {}
    }
    drop(lists);
    FastPath::No
}

/// As the rest of [`meet_guard`], where the bias of the commit lock was revoked meanwhile. The lock
/// of the wait point was kept.
///
/// # Safety
///
/// As there; the alternative was committed through this guard, which does not wait alone, or
/// through this node of a registered one.
#[cold]
#[inline(never)]
pub(super) unsafe fn give_revoked<const SEND: bool>(
    wait_point: &WaitPoint,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
    guard: NonNull<WaitNode>,
    ready: PlainPendingWake,
) -> FastPath {
    // SAFETY: the contract: until the guard is settled its select state is live.
    unsafe {
        let (select_state, _) = Waiter::<()>::guard_of(guard.cast());
        select_state.as_ref().after_revocation();
        let lists = wait_point.kept(turn);
        give::<SEND>(wait_point, lists, node, (guard, ready), turn)
    }
}

/// As [`meet`], where neither nothing nor a partner waits alone. The lock was kept.
///
/// # Safety
///
/// As there.
#[cold]
#[inline(never)]
unsafe fn meet_otherwise<const SEND: bool>(
    channel: NonNull<WaitPoint>,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the contract; the lock was kept.
    unsafe {
        let wait_point = channel.as_ref();
        let mut lists = wait_point.kept(turn);
        let mut nothing_waits = lists.leave_queues();
        if lists.waiting == Waiting::QUEUES && lists.is_plain_rendezvous() && !lists.is_storing {
            match take_first(lists.waiting_for::<SEND>(), turn) {
                Some(Some(partner)) => return give::<SEND>(wait_point, lists, node, partner, turn),
                Some(None) => nothing_waits = lists.leave_queues(),
                None => return FastPath::No,
            }
        }
        if nothing_waits {
            drop(lists);
            return match SEND {
                true => send(channel, node, turn),
                false => recv(channel, node, turn),
            };
        }
        if lists.waiting != Waiting::QUEUES {
            // A second operation of the same side.
            return FastPath::No;
        }
        if !lists.is_rendezvous() && lists.is_plain && lists.receivers.is_empty() {
            lists.keep();
            return meet_store::<SEND>(channel, node, turn);
        }
        FastPath::No
    }
}

/// Moves the value between the operation with this node and a partner that does not wait any more,
/// and lets the partner go.
///
/// # Safety
///
/// As for [`meet`]; the lock is held, and the partner waited for an operation of this side.
#[inline(always)]
unsafe fn give<const SEND: bool>(
    wait_point: &WaitPoint,
    lists: InsideGuard<'_, WaitQueues>,
    node: NonNull<Waiter<()>>,
    partner: (NonNull<WaitNode>, PlainPendingWake),
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the contract: a waiting sender holds its value, a waiting receiver holds none.
    unsafe {
        let (from, to) = match SEND {
            true => (node, partner.0.cast()),
            false => (partner.0.cast(), node),
        };
        move_value(wait_point, from, to);
        depart::<SEND>(wait_point, lists, partner, turn)
    }
}

/// Lets a partner go that an alternative has met, after the value was moved. The lock was kept.
///
/// # Safety
///
/// The partner waits alone, or is the first of its queue and a plain operation.
#[inline(always)]
pub(crate) unsafe fn part_from(
    wait_point: &WaitPoint,
    partner: NonNull<WaitNode>,
    by_sender: bool,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the contract.
    unsafe {
        match by_sender {
            true => part_kept::<true>(wait_point, partner, turn),
            false => part_kept::<false>(wait_point, partner, turn),
        }
    }
}

/// # Safety
///
/// As for [`part_from`].
#[inline(never)]
unsafe fn part_kept<const SEND: bool>(
    wait_point: &WaitPoint,
    partner: NonNull<WaitNode>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the contract.
    unsafe {
        let lists = wait_point.kept(turn);
        if lists.waiting.one(!SEND).is_none() {
            lists.keep();
            return part_queued::<SEND>(wait_point, turn);
        }
        part::<SEND>(wait_point, lists, partner, turn)
    }
}

/// As [`part_kept`], for a partner that is the first of its queue.
///
/// # Safety
///
/// As there.
#[cold]
#[inline(never)]
unsafe fn part_queued<const SEND: bool>(wait_point: &WaitPoint, turn: PlainTurn<'_>) -> FastPath {
    // SAFETY: the contract.
    unsafe {
        let mut lists = wait_point.kept(turn);
        match take_first(lists.waiting_for::<SEND>(), turn) {
            Some(Some(partner)) => depart::<SEND>(wait_point, lists, partner, turn),
            _ => unreachable!("the first of a queue has changed under the lock"),
        }
    }
}

/// As [`meet`].
///
/// # Safety
///
/// As there.
#[inline(never)]
unsafe fn send(
    channel: NonNull<WaitPoint>,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the contract.
    unsafe { meet::<true>(channel, node, turn) }
}

/// As [`meet`].
///
/// # Safety
///
/// As there.
#[inline(never)]
unsafe fn recv(
    channel: NonNull<WaitPoint>,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the contract.
    unsafe { meet::<false>(channel, node, turn) }
}

impl<T> Channel<T> {
    /// Meets the partner, or lets the operation wait. O(1), without atomic read-modify-writes.
    ///
    /// # Safety
    ///
    /// `node` is a plain operation's and not listed, and no other thread accesses it. A send's
    /// holds its value, a receive's none. It stays where it is until it is settled or withdrawn.
    #[inline(always)]
    pub(crate) unsafe fn meet_fast(
        &self,
        is_sender: bool,
        node: NonNull<Waiter<T>>,
        turn: PlainTurn<'_>,
    ) -> FastPath {
        // The wait point is the channel's first field.
        let channel = NonNull::from(self).cast();
        // SAFETY: the contract.
        unsafe {
            match is_sender {
                true => send(channel, node.cast(), turn),
                false => recv(channel, node.cast(), turn),
            }
        }
    }
}

/// Ends an operation that is done without a partner.
///
/// # Safety
///
/// `lists` are those of `wait_point`.
#[inline(always)]
pub(super) unsafe fn leave_done(
    wait_point: &WaitPoint,
    lists: InsideGuard<'_, WaitQueues>,
    turn: PlainTurn<'_>,
) -> FastPath {
    if !lists.leave() {
        return leave_revoked(wait_point, turn);
    }
    match turn.goes_on() {
        true => FastPath::Done,
        false => give_way(turn),
    }
}

#[cold]
#[inline(never)]
fn leave_revoked(wait_point: &WaitPoint, turn: PlainTurn<'_>) -> FastPath {
    wait_point.after_revocation();
    give_way(turn)
}

/// Counts an operation that is done, and yields if another process is to run first.
#[inline(never)]
fn give_way(turn: PlainTurn<'_>) -> FastPath {
    FastPath::done(turn)
}
