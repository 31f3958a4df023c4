//! Communication between two processes of one executor, over a channel that is used for plain sends
//! and receives only: nearly every communication.
//!
//! It gives the same results as [`ChannelGuard`](super::ChannelGuard), without branches for what is
//! not there: the lock is biased to the executor, so it is taken and left by plain stores; no waker
//! is cloned or called; no alternative is registered, no call is served, no buffer overwrites; the
//! process is neither recorded nor has a replay log. Whenever one of these conditions does not
//! hold, no state has changed, and the operation takes the slow path.
//!
//! ```text
//!   plain turn? --> lock biased to this executor? --> what waits, one word?
//!      | no              | no                           | nothing: the node waits alone
//!      '--> slow path <--'                              | a partner alone: move, leave, ready it
//!                ^                                      | a buffer: store or take a value
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
use crate::source::{Offered, Source};
use crate::wait_point::{LastUser, WaitPoint, WaitQueues, Waiting};
use crate::waiter::Waiter;
use luna_core::biased_lock::{InsideGuard, Refused};
use luna_core::current::{self, PlainPendingWake, PlainTurn, Process};
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
    /// Fast path unavailable; no state changed. Take the slow path.
    No,
    /// There is a buffer. The lock is kept.
    Store,
    /// An alternative is registered. The lock is kept.
    More,
}

impl FastPath {
    /// It is done: counts it, and yields if another process is to run first.
    #[inline(always)]
    fn done_in(turn: PlainTurn<'_>) -> FastPath {
        match turn.goes_on() {
            true => FastPath::Done,
            // SAFETY: a turn has a current process of an executor.
            false => unsafe { Self::done(turn.process()) },
        }
    }

    /// # Safety
    ///
    /// As for [`current::gives_way`].
    #[inline(always)]
    pub(super) unsafe fn done(process: &Process) -> FastPath {
        // SAFETY: the contract is the same.
        match unsafe { current::gives_way(process) } {
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
/// stays where it is until it is settled or withdrawn.
#[inline(always)]
unsafe fn meet<const SEND: bool>(
    wait_point: &WaitPoint,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: a thread holds no lock of a wait point when it polls.
    let mut lists = match unsafe { wait_point.enter(turn) } {
        Ok(lists) => lists,
        Err(Refused::NotBiased) => return FastPath::No,
        Err(Refused::Revoked) => return revoked(wait_point, FastPath::No),
    };
    // SAFETY: the contract. The lock is held: a node that waits alone is live, and belongs to a
    // process of this executor.
    unsafe {
        if let Some(partner) = lists.waiting.one(!SEND) {
            let (from, to) = match SEND {
                true => (node, partner.cast()),
                false => (partner.cast(), node),
            };
            if !lists.moves_word {
                lists.keep();
                return part_long::<SEND>(wait_point, (from, to), turn);
            }
            Waiter::move_word(from, to);
            return part::<SEND>(wait_point, lists, partner, turn);
        }
        if lists.waiting.is_idle() {
            note_user::<SEND>(&mut lists, turn.process());
            Waiter::begin_alone(node, turn.process());
            lists.set_alone(node.cast(), SEND);
            if !lists.leave() {
                return revoked(wait_point, FastPath::Waits);
            }
            return FastPath::Waits;
        }
        let is_store = lists.waiting.is_store();
        lists.keep();
        if is_store {
            return FastPath::Store;
        }
        meet_otherwise::<SEND>(wait_point, node, turn)
    }
}

/// Lets the partner go after the value was moved: it is ready from here on.
///
/// # Safety
///
/// The partner waits alone.
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

/// As the rest of [`part`], for a partner that does not wait any more, with its wake.
///
/// # Safety
///
/// As there.
#[inline(always)]
unsafe fn depart<const SEND: bool>(
    wait_point: &WaitPoint,
    mut lists: InsideGuard<'_, WaitQueues>,
    (partner, ready): (NonNull<WaitNode>, PlainPendingWake),
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the contract.
    unsafe {
        note_user::<SEND>(&mut lists, turn.process());
        Waiter::<()>::settle_plain(partner.cast());
        if !lists.leave() {
            return part_revoked(wait_point, ready, turn);
        }
        match ready.wake_alone(turn) {
            Ok(()) => FastPath::Done,
            Err(ready) => wake_otherwise(ready, turn),
        }
    }
}

/// As the rest of [`meet`], for a value that is longer than a word. The lock was kept.
///
/// # Safety
///
/// As there; the value is to be moved from the first node to the second, one of which is the
/// partner's.
#[inline(never)]
unsafe fn part_long<const SEND: bool>(
    wait_point: &WaitPoint,
    (from, to): (NonNull<Waiter<()>>, NonNull<Waiter<()>>),
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the contract.
    unsafe {
        move_value(wait_point, from, to);
        let partner = if SEND { to } else { from };
        let lists = wait_point.kept(turn.executor_number());
        part::<SEND>(wait_point, lists, partner.cast(), turn)
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
        FastPath::done(turn.process())
    }
}

#[inline(always)]
fn note_user<const SEND: bool>(lists: &mut WaitQueues, process: &Process) {
    let user = LastUser::process(process.id());
    match SEND {
        true => lists.sender = user,
        false => lists.receiver = user,
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
    wait_point: &WaitPoint,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the contract; the lock was kept.
    unsafe {
        let mut lists = wait_point.kept(turn.executor_number());
        let mut nothing_waits = lists.leave_queues();
        if let Some(guard) = lists.waiting.guard(!SEND) {
            match commit(guard, turn) {
                Commit::Chosen(ready) => {
                    lists.set_nothing_waits();
                    return give::<SEND>(wait_point, lists, node, (guard, ready), turn);
                }
                Commit::Stale => {
                    lists.set_nothing_waits();
                    Waiter::<()>::settle_stale(guard.cast());
                    nothing_waits = true;
                }
                Commit::No => return FastPath::No,
            }
        } else if lists.waiting == Waiting::QUEUES
            && lists.is_plain_rendezvous()
            && !lists.is_storing
        {
            match take_first(lists.waiting_for::<SEND>(), turn) {
                Some(Some(partner)) => return give::<SEND>(wait_point, lists, node, partner, turn),
                Some(None) => nothing_waits = lists.leave_queues(),
                None => return FastPath::No,
            }
        }
        if nothing_waits {
            drop(lists);
            return match SEND {
                true => send(wait_point, node, turn),
                false => recv(wait_point, node, turn),
            };
        }
        if lists.waiting != Waiting::QUEUES {
            // A second operation of the same side.
            return FastPath::No;
        }
        if !lists.is_rendezvous() && lists.is_plain() && lists.receivers.is_empty() {
            lists.keep();
            return FastPath::Store;
        }
        if SEND && lists.is_plain_but_registered() {
            lists.keep();
            return FastPath::More;
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
        let mut lists = wait_point.kept(turn.executor_number());
        if lists.waiting.one(!SEND).is_some() {
            return part::<SEND>(wait_point, lists, partner, turn);
        }
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
unsafe fn send(wait_point: &WaitPoint, node: NonNull<Waiter<()>>, turn: PlainTurn<'_>) -> FastPath {
    // SAFETY: the contract.
    unsafe { meet::<true>(wait_point, node, turn) }
}

/// As [`meet`].
///
/// # Safety
///
/// As there.
#[inline(never)]
unsafe fn recv(wait_point: &WaitPoint, node: NonNull<Waiter<()>>, turn: PlainTurn<'_>) -> FastPath {
    // SAFETY: the contract.
    unsafe { meet::<false>(wait_point, node, turn) }
}

impl<T> Channel<T> {
    /// Sends, or lets the sender wait. O(1), without atomic read-modify-writes. If the result is
    /// `Store` or `More`, [`store_fast`](Self::store_fast) or [`send_to_more`](Self::send_to_more)
    /// is to be called at once.
    ///
    /// # Safety
    ///
    /// `node` is not listed, no other thread accesses it, and it holds a value. It stays where it
    /// is until it is settled or withdrawn.
    #[inline(always)]
    pub(crate) unsafe fn send_fast(
        &self,
        node: NonNull<Waiter<T>>,
        turn: PlainTurn<'_>,
    ) -> FastPath {
        // SAFETY: the contract.
        unsafe { send(&self.wait_point, node.cast(), turn) }
    }

    /// Sends to a registered alternative, or lists the sender.
    ///
    /// # Safety
    ///
    /// As for [`send_fast`](Self::send_fast), which was called just before and has returned
    /// `More`.
    pub(crate) unsafe fn send_to_more<S: Source<T>>(
        &self,
        offered: NonNull<Offered<T, S>>,
    ) -> FastPath {
        // SAFETY: the contract: this is a process' plain turn, and its executor has the lock.
        unsafe {
            let process = current::this_process();
            let lists = self.wait_point.kept(process.executor_number());
            self.send_to_registered(lists, offered, process)
        }
    }

    /// Stores the value of a sender, or lists the sender.
    ///
    /// # Safety
    ///
    /// `node` holds a value; as for [`send_fast`](Self::send_fast), which was called just before
    /// and has returned `Store`.
    #[inline]
    pub(crate) unsafe fn store_fast(
        &self,
        node: NonNull<Waiter<T>>,
        turn: PlainTurn<'_>,
    ) -> FastPath {
        // SAFETY: the contract: the executor has kept the lock, which guards the store too.
        unsafe {
            let process = turn.process();
            let mut lists = self.wait_point.kept(turn.executor_number());
            if self.store.with(|store| (*store).len() < self.capacity()) {
                note_user::<true>(&mut lists, process);
                let value = Waiter::take_value_of(node);
                self.store.with_mut(|store| (*store).push_back(value));
                lists.is_storing = true;
                if !lists.leave() {
                    self.wait_point.after_revocation();
                }
                return FastPath::done_in(turn);
            }
            if !lists.senders.is_empty() {
                return FastPath::No;
            }
            note_user::<true>(&mut lists, process);
            lists.list_alone();
            Waiter::begin_plain(node, process);
            lists.senders.insert_alone(node.cast());
            FastPath::Waits
        }
    }

    /// Receives into the node, or lets the receiver wait. O(1), without atomic read-modify-writes.
    /// If the result is `Store`, [`recv_stored`](Self::recv_stored) is to be called at once.
    ///
    /// # Safety
    ///
    /// `node` is not listed, no other thread accesses it, and it holds no value. It stays where it
    /// is until it is settled or withdrawn.
    #[inline(always)]
    pub(crate) unsafe fn recv_fast(
        &self,
        node: NonNull<Waiter<T>>,
        turn: PlainTurn<'_>,
    ) -> FastPath {
        // SAFETY: the contract.
        unsafe { recv(&self.wait_point, node.cast(), turn) }
    }

    /// Receives a stored value, and a waiting sender moves up; or lets the receiver wait.
    ///
    /// # Safety
    ///
    /// As for [`recv_fast`](Self::recv_fast), which was called just before and has returned
    /// `Store`.
    #[inline]
    pub(crate) unsafe fn recv_stored(
        &self,
        node: NonNull<Waiter<T>>,
        turn: PlainTurn<'_>,
    ) -> FastPath {
        // SAFETY: the contract: the executor has kept the lock, which guards the store too.
        unsafe {
            let process = turn.process();
            let mut lists = self.wait_point.kept(turn.executor_number());
            let stored = self.store.with(|store| (*store).len());
            // Values given back by dropped futures may exceed the capacity.
            if stored > self.capacity() {
                return FastPath::No;
            }
            let mut moves_up = None;
            if let Some(first) = lists.senders.first() {
                let Some(ready) = Waiter::take_plain_wake_handle(first.cast::<Waiter<T>>()) else {
                    return FastPath::No;
                };
                moves_up = Some((first, ready));
            }
            note_user::<false>(&mut lists, process);
            let Some(value) = self.store.with_mut(|store| (*store).pop_front()) else {
                if !lists.waiting.is_store() {
                    return FastPath::No;
                }
                Waiter::begin_alone(node, process);
                lists.set_alone(node.cast(), false);
                return FastPath::Waits;
            };
            Waiter::put_value_of(node, value);
            let Some((first, ready)) = moves_up else {
                lists.is_storing = stored > 1;
                if !lists.leave() {
                    self.wait_point.after_revocation();
                }
                return FastPath::done_in(turn);
            };
            let sender = first.cast::<Waiter<T>>();
            lists.senders.remove_first(first);
            let next = Waiter::take_value_of(sender);
            self.store.with_mut(|store| (*store).push_back(next));
            Waiter::settle_plain(sender);
            drop(lists);
            ready.wake();
            FastPath::done(process)
        }
    }
}

/// Takes the value of the first waiting sender, if that is a plain operation's. The caller wakes it
/// when the lock is released. `None`: no state changed.
///
/// # Safety
///
/// `first` is the first of the senders, in a channel of values of this type; this executor holds
/// its lock.
#[inline(always)]
pub(super) unsafe fn take_from_first<T>(
    lists: &mut WaitQueues,
    first: NonNull<WaitNode>,
    process: &Process,
) -> Option<(T, PlainPendingWake)> {
    // SAFETY: the contract; a listed sender's node holds its value.
    unsafe {
        let sender = first.cast::<Waiter<T>>();
        let ready = Waiter::take_plain_wake_handle(sender)?;
        note_user::<false>(lists, process);
        lists.senders.remove_first(first);
        let value = Waiter::take_value_of(sender);
        Waiter::settle_plain(sender);
        Some((value, ready))
    }
}
