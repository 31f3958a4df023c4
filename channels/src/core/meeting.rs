//! How two processes of one executor meet: the part of [`fast_path`](super::fast_path) that does
//! not depend on the type of the value.
//!
//! The channels of all types share one copy of it. A system has processes of many kinds, and its
//! channels many types: with a copy for each, the code of a cycle exceeds the first-level cache,
//! and a loop that sleeps between its cycles waits for its code more than it computes
//! (docs/performance.md, "After a sleep").
//!
//! ```text
//!   come_to_send, come_to_receive --> nobody: listed, the lock is free
//!             |
//!             '--> a partner, the lock is kept --> the value is moved --> part_from_receiver, part_from_sender: settled, the lock is free, ready
//! ```

use super::FastPath;
use crate::wait_point::{LastUser, WaitPoint, WaitQueues, user_number};
use crate::waiter::Waiter;
use luna_core::biased_lock::InsideGuard;
use luna_core::current::{self, Process};
use luna_core::wait_list::WaitNode;
use std::hint::{assert_unchecked, cold_path};
use std::ptr::NonNull;
use std::task::Context;

/// What a process finds on the fast path of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Found {
    /// Fast path unavailable; no state changed. Take the slow path.
    No,
    /// No partner: the node is listed.
    Nobody,
    /// This partner waits in a plain operation. The lock is kept until the two have parted.
    Partner(NonNull<WaitNode>),
    /// No partner, but a buffer: a sender may find room in it, a receiver finds a value. The lock
    /// is kept.
    Buffer,
    /// Something else: an alternative. The lock is kept.
    More,
}

/// The process in its plain turn, recorded or not.
#[inline(always)]
fn turn<'a, const RECORDED: bool>(cx: &'a Context<'_>) -> Option<&'a Process> {
    match RECORDED {
        true => current::plain_turn(cx),
        false => current::unrecorded_turn(cx),
    }
}

/// The process in its plain turn, and the partner that waits at the wait point, if its lock is
/// biased to the executor of that process.
#[inline(always)]
fn enter<'a, const RECORDED: bool>(
    place: &'a WaitPoint,
    cx: &'a Context<'_>,
) -> Option<(&'a Process, InsideGuard<'a, WaitQueues>)> {
    let Some(process) = turn::<RECORDED>(cx) else {
        cold_path();
        return None;
    };
    // SAFETY: this is the thread of the process' executor.
    let Some(lists) = (unsafe { place.lock_if_favoured(process.home_number()) }) else {
        cold_path();
        return None;
    };
    Some((process, lists))
}

/// Looks for a waiting receiver, and lists the sender if there is none. O(1).
///
/// # Safety
///
/// `node` is that of a send to the channel around `place` that is not listed. No other thread
/// accesses it, and it stays where it is until it is settled or withdrawn.
#[inline(never)]
pub(super) unsafe fn come_to_send<const RECORDED: bool>(
    place: &WaitPoint,
    node: NonNull<Waiter<()>>,
    cx: &Context<'_>,
) -> Found {
    let Some((process, mut lists)) = enter::<RECORDED>(place, cx) else {
        return Found::No;
    };
    // SAFETY: under the lock a listed node may be read. The way in which a node is listed does not
    // depend on its value.
    unsafe {
        if lists.is_plain {
            if let Some(first) = lists.receivers.first() {
                if Waiter::has_plain_wakeup(first.cast::<Waiter<()>>()) {
                    lists.keep();
                    return Found::Partner(first);
                }
            } else if lists.is_rendezvous {
                if !lists.senders.is_empty() {
                    cold_path();
                    return Found::No;
                }
                lists.sender = LastUser::process(process.id());
                Waiter::begin_plain(node, process);
                lists.senders.insert_alone(node.cast());
                return Found::Nobody;
            } else {
                lists.keep();
                return Found::Buffer;
            }
        }
        lists.keep();
        Found::More
    }
}

/// Looks for a waiting sender, and lists the receiver if there is none. O(1).
///
/// # Safety
///
/// As for [`come_to_send`], of a receive.
#[inline(never)]
pub(super) unsafe fn come_to_receive<const RECORDED: bool>(
    place: &WaitPoint,
    node: NonNull<Waiter<()>>,
    cx: &Context<'_>,
) -> Found {
    let Some((process, mut lists)) = enter::<RECORDED>(place, cx) else {
        return Found::No;
    };
    // SAFETY: as above.
    unsafe {
        if !lists.is_plain {
            cold_path();
            return Found::No;
        }
        if lists.is_storing {
            lists.keep();
            return Found::Buffer;
        }
        let Some(first) = lists.senders.first() else {
            if !lists.receivers.is_empty() {
                cold_path();
                return Found::No;
            }
            lists.receiver = LastUser::process(process.id());
            Waiter::begin_plain(node, process);
            lists.receivers.insert_alone(node.cast());
            return Found::Nobody;
        };
        lists.keep();
        match Waiter::has_plain_wakeup(first.cast::<Waiter<()>>()) {
            true => Found::Partner(first),
            false => Found::More,
        }
    }
}

/// Lets the receiver go after it has been given its value: it is ready from here on.
///
/// # Safety
///
/// It is the [partner](Found::Partner) that the process in its plain turn has found in `place`; the
/// process has kept the lock.
#[inline(never)]
pub(super) unsafe fn part_from_receiver<const RECORDED: bool>(
    place: &WaitPoint,
    receiver: NonNull<WaitNode>,
) -> FastPath {
    // SAFETY: by the contract, the partner was found by its plain wake handle, and under the lock
    // no other thread has taken that.
    unsafe {
        let process = current::this_process();
        let mut lists = place.kept(process.home_number());
        assert_unchecked(Waiter::has_plain_wakeup(receiver.cast::<Waiter<()>>()));
        let ready = Waiter::take_plain_wakeup(receiver.cast::<Waiter<()>>()).unwrap_unchecked();
        ready.fetch();
        if RECORDED {
            place.tell(|| [process.id().get().into(), user_number(receiver)]);
        }
        lists.sender = LastUser::process(process.id());
        lists.receivers.remove_first(receiver);
        Waiter::settle_plain(receiver.cast::<Waiter<()>>());
        drop(lists);
        ready.wake();
        FastPath::done(process)
    }
}

/// Lets the sender go after its value has been taken: it is ready from here on.
///
/// # Safety
///
/// As for [`part_from_receiver`].
#[inline(never)]
pub(super) unsafe fn part_from_sender<const RECORDED: bool>(
    place: &WaitPoint,
    sender: NonNull<WaitNode>,
) -> FastPath {
    // SAFETY: as above.
    unsafe {
        let process = current::this_process();
        let mut lists = place.kept(process.home_number());
        assert_unchecked(Waiter::has_plain_wakeup(sender.cast::<Waiter<()>>()));
        let ready = Waiter::take_plain_wakeup(sender.cast::<Waiter<()>>()).unwrap_unchecked();
        ready.fetch();
        if RECORDED {
            place.tell(|| [user_number(sender), process.id().get().into()]);
        }
        lists.receiver = LastUser::process(process.id());
        lists.senders.remove_first(sender);
        Waiter::settle_plain(sender.cast::<Waiter<()>>());
        drop(lists);
        ready.wake();
        FastPath::done(process)
    }
}
