//! Partners that wait in a queue, and those that an alternative has met.

use super::{FastPath, give, meet_store, part, recv, send};
use crate::alternative::take_first;
use crate::wait_point::{WaitPoint, WaitQueues, Waiting};
use crate::waiter::Waiter;
use core::ptr::NonNull;
use luna_core::biased_lock::InsideGuard;
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
///
/// # Safety
///
/// The lists are those of `wait_point`, and the value was moved. The partner waits alone.
#[inline(always)]
pub(crate) unsafe fn part_alone(
    wait_point: &WaitPoint,
    lists: InsideGuard<'_, WaitQueues>,
    partner: NonNull<WaitNode>,
    by_sender: bool,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the lists are those of the wait point, the value was moved, and the partner waits
    // alone, as is demanded here and there.
    unsafe {
        match by_sender {
            true => part_met::<true>(wait_point, lists, partner, turn),
            false => part_met::<false>(wait_point, lists, partner, turn),
        }
    }
}

/// # Safety
///
/// As for [`part_alone`]: of `lists` and the partner, which waits alone; the value was moved.
#[inline(never)]
unsafe fn part_met<const SEND: bool>(
    wait_point: &WaitPoint,
    lists: InsideGuard<'_, WaitQueues>,
    partner: NonNull<WaitNode>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the lists are those of the wait point, and the partner waits alone, as `part` demands.
    unsafe { part::<SEND>(wait_point, lists, partner, turn) }
}
