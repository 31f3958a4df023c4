//! Partners that wait in a queue, and those that an alternative has met.

use super::{FastPath, depart, give, meet_store, part, recv, send};
use crate::alternative::take_first;
use crate::wait_point::{WaitPoint, Waiting};
use crate::waiter::Waiter;
use core::ptr::NonNull;
use luna_core::current::PlainTurn;
use luna_core::wait_list::WaitNode;

/// As [`meet`](super::meet), where something waits, but no partner alone. The lock was kept.
///
/// # Safety
///
/// As for [`meet`](super::meet): of `channel` and `node`. The lock was kept.
#[cold]
#[inline(never)]
pub(super) unsafe fn meet_otherwise<const SEND: bool>(
    channel: NonNull<WaitPoint>,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the lock was kept, and is taken back once in each way. The channel is live, and the
    // node new, as for `meet`. `take_first` gets a queue of a plain channel without a buffer, and
    // what it takes was committed and is not settled, as `give` demands. `send` and `recv` are
    // called without the lock.
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

/// Lets a partner go that waits alone and that an alternative has met, after the value was moved.
/// The lock was kept.
///
/// # Safety
///
/// This thread has kept the lock, and the value was moved. The partner waits alone.
#[inline(always)]
pub(crate) unsafe fn part_alone(
    wait_point: &WaitPoint,
    partner: NonNull<WaitNode>,
    by_sender: bool,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the lock was kept, the value was moved, and the partner waits alone, as is demanded
    // here and there.
    unsafe {
        match by_sender {
            true => part_kept::<true>(wait_point, partner, turn),
            false => part_kept::<false>(wait_point, partner, turn),
        }
    }
}

/// # Safety
///
/// As for [`part_alone`]: the lock was kept, the value was moved, and the partner waits alone.
#[inline(never)]
unsafe fn part_kept<const SEND: bool>(
    wait_point: &WaitPoint,
    partner: NonNull<WaitNode>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the lock was kept, and is taken back once. The partner waits alone, as `part`
    // demands.
    unsafe { part::<SEND>(wait_point, wait_point.kept(turn), partner, turn) }
}

/// As [`part_alone`], for the first partner of a queue.
///
/// # Safety
///
/// This thread has kept the lock, of a plain channel without a buffer, and the value was moved. The
/// partner is the first of its queue and a plain operation, of which
/// [`Waiter::has_plain_wake_handle`] is true.
#[cold]
#[inline(never)]
pub(crate) unsafe fn part_queued(
    wait_point: &WaitPoint,
    by_sender: bool,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the lock was kept, and is taken back once. The queue is that of a plain channel
    // without a buffer, as is demanded here. The partner was taken off, as `depart` demands.
    unsafe {
        let mut lists = wait_point.kept(turn);
        let queue = match by_sender {
            true => lists.waiting_for::<true>(),
            false => lists.waiting_for::<false>(),
        };
        match (take_first(queue, turn), by_sender) {
            (Some(Some(partner)), true) => depart::<true>(wait_point, lists, partner, turn),
            (Some(Some(partner)), false) => depart::<false>(wait_point, lists, partner, turn),
            _ => unreachable!("the first of a queue has changed under the lock"),
        }
    }
}
