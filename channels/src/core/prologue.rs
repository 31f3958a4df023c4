//! The prologue of a plain send or receive between processes of one executor: nearly every
//! communication.
//!
//! It is the same protocol as under the lock in any other way (`Operation::attempt_under`), without
//! branches for what is not there: the lock is biased to the executor, so it is taken and left by
//! plain stores; no waker is cloned or called; the process is neither traced nor has a replay log.
//! The lock's word says what waits. Where that is none of the cases below, no value has moved, and
//! the operation goes on under the lock that was taken here.
//!
//! ```text
//!   lock biased to this executor? --> what waits, one word?
//!      | no                             | nothing: the node waits alone
//!      v                                | a partner alone: move, leave, ready it
//!   takes the lock                      | a guard alone: commit it, then as above
//!      |                                | a registered alternative: as a guard
//!      |                                | a buffer with room, or with a value: store or take it
//!      '-----> any other case <---------' queues
//! ```
//!
//! A node that waits alone belongs to a process of this very executor: only the executor that owns
//! the bias lets a node wait so, and a lock is biased to no second one.
//!
//! [`meet`] does not depend on the type of the values, so all channels share one copy of it
//! for each direction. A system has processes of many kinds, and its channels many types: with a
//! copy for each, the code of a cycle exceeds the first-level cache, and a loop that sleeps between
//! its cycles waits for its code more than it computes (docs/performance.md, "After a sleep").

use super::Channel;
use crate::alternative::{Commit, commit};
use crate::wait_point::{LastUser, WaitPoint, WaitQueues, Waiting};
use crate::waiter::{Outcome, Waiter};
use core::hint::assert_unchecked;
use core::ptr::NonNull;
use luna_core::biased_lock::{InsideGuard, Refused};
use luna_core::current::{PlainPendingWake, PlainTurn};
use luna_core::wait_list::WaitNode;

/// Result of an operation on the fast path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FastPath {
    /// It is done, and the partner is ready.
    Done,
    /// The node waits.
    Waits,
    /// It is done, and the process is queued again: others run first.
    GaveWay,
    /// No value has moved, and the operation is as new. The lock was [kept](InsideGuard::keep): the
    /// operation goes on under it.
    Inside,
    /// Nothing has happened: the lock is not biased to this executor.
    No,
}

/// A step that depends on the type of the channel's values: the rest of [`meet`] where its
/// condition holds.
///
/// # Safety
///
/// The arguments are those of a [`Plain`] operation, of the direction of the step, at a channel of
/// such values. This thread has kept the lock of that.
pub(crate) type Meet =
    unsafe fn(NonNull<WaitPoint>, NonNull<Waiter<()>>, PlainTurn<'_>) -> FastPath;

impl FastPath {
    /// Of an operation that is done.
    #[inline(always)]
    fn done(turn: PlainTurn<'_>) -> FastPath {
        match turn.yields_after_operation() {
            true => FastPath::GaveWay,
            false => FastPath::Done,
        }
    }
}

/// A plain operation that is new: a send if `SEND`, else a receive. Functions that are not inlined
/// take its fields in this order, so that none is moved between registers.
///
/// # Invariants
///
/// `channel` is a pointer to the whole of a live channel, which the operation's end keeps. `node`
/// is the operation's, of that channel, and not listed: a send's holds its value, a receive's none.
/// No other thread accesses it, and it stays where it is until it is settled or withdrawn. `turn`
/// is that of the poll.
#[derive(Clone, Copy)]
pub(super) struct Plain<'a, const SEND: bool> {
    channel: NonNull<WaitPoint>,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'a>,
}

impl<'a, const SEND: bool> Plain<'a, SEND> {
    /// # Safety
    ///
    /// By the type's invariants.
    #[inline(always)]
    pub(super) unsafe fn new(
        channel: NonNull<WaitPoint>,
        node: NonNull<Waiter<()>>,
        turn: PlainTurn<'a>,
    ) -> Self {
        Self {
            channel,
            node,
            turn,
        }
    }

    #[inline(always)]
    pub(super) fn wait_point(self) -> &'a WaitPoint {
        // SAFETY: by the invariants it leads to a live channel, whose first field is this.
        unsafe { self.channel.as_ref() }
    }

    /// Lets the operation wait alone.
    ///
    /// # Safety
    ///
    /// The lists are those of the channel, where nothing waits.
    #[inline(always)]
    pub(super) unsafe fn wait_alone(self, mut lists: InsideGuard<'_, WaitQueues>) -> FastPath {
        // Read before the stores: the process is read once then.
        let user = LastUser::process(self.turn.process().id());
        // SAFETY: by the invariants the node is in no list and no other thread accesses it.
        unsafe { Waiter::begin_alone(self.node, self.turn) };
        lists.note_user(SEND, user);
        lists.set_alone(self.node.cast(), SEND);
        match lists.leave() {
            true => FastPath::Waits,
            false => self.wait_point().revoked(FastPath::Waits),
        }
    }
}

/// The node of the sender, and that of the receiver.
#[inline(always)]
fn nodes_of<const SEND: bool>(
    node: NonNull<Waiter<()>>,
    partner: NonNull<WaitNode>,
) -> (NonNull<Waiter<()>>, NonNull<Waiter<()>>) {
    match SEND {
        true => (node, partner.cast()),
        false => (partner.cast(), node),
    }
}

/// Moves a value of any type.
///
/// # Safety
///
/// The lock of `wait_point` is held. `node` is that of a new plain operation of this side there.
/// The partner waited for one, and is not settled.
#[inline(always)]
unsafe fn move_value<const SEND: bool>(
    wait_point: &WaitPoint,
    node: NonNull<Waiter<()>>,
    partner: NonNull<WaitNode>,
) {
    let (from, to) = nodes_of::<SEND>(node, partner);
    // SAFETY: of the two nodes the sender's holds a value and the receiver's none, since one is new
    // and the other not settled. The lock is held, so no other thread accesses them. A channel
    // gives its wait point the mover for the type of its values, or none if a word holds one.
    unsafe {
        match wait_point.identity.values.mover {
            Some(mover) => mover(from, to),
            None => Waiter::move_word(from, to),
        }
    }
}

/// The rest of [`meet`], for a value that is longer than a word.
///
/// # Safety
///
/// As for [`Plain`]; the lock was kept, and `partner` waits alone for an operation of this side.
#[inline(never)]
unsafe fn part_long<const SEND: bool>(
    channel: NonNull<WaitPoint>,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
    partner: NonNull<WaitNode>,
) -> FastPath {
    // SAFETY: the lock was kept, and is taken back once. The partner waits alone, as `move_value`
    // and `part` demand.
    unsafe {
        let plain = Plain::<SEND>::new(channel, node, turn);
        let wait_point = plain.wait_point();
        move_value::<SEND>(wait_point, node, partner);
        part::<SEND>(wait_point, wait_point.kept(turn), partner, turn)
    }
}

/// The rest of [`meet`], where a guard waits alone for an operation of this side: its
/// alternative is committed first.
///
/// # Safety
///
/// As for [`Plain`]; the lock was kept, and `guard` waits alone for an operation of this side.
#[inline(never)]
unsafe fn meet_guard<const SEND: bool>(
    channel: NonNull<WaitPoint>,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
    guard: NonNull<WaitNode>,
) -> FastPath {
    // SAFETY: the lock was kept, and is taken back once. A guard that waits alone was begun with
    // its select state, and no other thread can withdraw it under the lock: so `commit` finds that
    // live. A stale guard is settled before `wait_alone` overwrites its note; a chosen one is taken
    // off for `depart`.
    unsafe {
        let plain = Plain::<SEND>::new(channel, node, turn);
        let mut lists = plain.wait_point().kept(turn);
        match commit(Waiter::<()>::guard_of(guard.cast()), turn) {
            Commit::Chosen(ready) => {
                lists.set_nothing_waits();
                move_value::<SEND>(plain.wait_point(), node, guard);
                depart::<SEND>(plain.wait_point(), lists, (guard, ready), turn)
            }
            Commit::Stale => {
                Waiter::<()>::set_outcome(guard.cast(), Outcome::Stale);
                plain.wait_alone(lists)
            }
            Commit::No => go_on_inside(lists),
        }
    }
}

/// The rest of [`meet`], where something else waits, or has waited until now.
///
/// # Safety
///
/// As for [`Plain`]; the lock was kept.
#[cold]
#[inline(never)]
unsafe fn meet_queues<const SEND: bool>(
    channel: NonNull<WaitPoint>,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the lock was kept, and is taken back once; the operation meets again without it.
    unsafe {
        let mut lists = channel.as_ref().kept(turn);
        if !lists.leave_queues() {
            return go_on_inside(lists);
        }
        drop(lists);
        meet::<SEND>(channel, node, turn)
    }
}

/// The operation goes on under the lock.
#[inline(always)]
pub(super) fn go_on_inside(lists: InsideGuard<'_, WaitQueues>) -> FastPath {
    lists.keep();
    FastPath::Inside
}

/// Meets what waits alone, or lets the operation wait: one copy for all sends, and one for all
/// receives. O(1).
///
/// # Safety
///
/// As for [`Plain`].
#[inline(never)]
unsafe fn meet<const SEND: bool>(
    channel: NonNull<WaitPoint>,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: as is demanded here.
    let plain = unsafe { Plain::<SEND>::new(channel, node, turn) };
    let wait_point = plain.wait_point();
    // SAFETY: a plain turn's poll begins without a lock of a wait point, on this thread. The
    // closure of a `send_with` runs under one, but it has no plain turn.
    let lists = match unsafe { wait_point.lock.enter_trusted(turn) } {
        Ok(lists) => lists,
        Err(Refused::NotBiased) => return FastPath::No,
        Err(Refused::Revoked) => return wait_point.revoked(FastPath::No),
    };
    let waiting = lists.waiting;
    // SAFETY: the lock is held, so that a node that waits alone is live and not settled, and
    // belongs to a process of this executor. `moves_word` says that the channel's values need
    // no mover. Where the lock is kept, the callee takes it back, for this operation.
    unsafe {
        if let Some(partner) = waiting.one(!SEND) {
            if !lists.moves_word {
                lists.keep();
                return part_long::<SEND>(channel, node, turn, partner);
            }
            let (from, to) = nodes_of::<SEND>(node, partner);
            Waiter::move_word(from, to);
            return part::<SEND>(wait_point, lists, partner, turn);
        }
        if waiting.is_idle() {
            return plain.wait_alone(lists);
        }
        lists.keep();
        let values = wait_point.identity.values;
        if waiting.is_store() {
            return match SEND {
                true => (values.store)(channel, node, turn),
                false => (values.take)(channel, node, turn),
            };
        }
        if SEND && waiting == Waiting::REGISTERED {
            return (values.send_to_registered)(channel, node, turn);
        }
        match waiting.guard(!SEND) {
            Some(guard) => meet_guard::<SEND>(channel, node, turn, guard),
            None => meet_queues::<SEND>(channel, node, turn),
        }
    }
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
        // SAFETY: `channel` was made of a reference to the whole. By `# Safety` the node is new,
        // holds a value if it sends and none if it receives, is known to its future alone, and
        // stays: as [`Plain`] demands.
        let met = unsafe {
            match is_sender {
                true => meet::<true>(channel, node.cast(), turn),
                false => meet::<false>(channel, node.cast(), turn),
            }
        };
        #[cfg(test)]
        taken::note(met);
        met
    }
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
    // SAFETY: the partner waits alone, so `begin_alone` has written its wake, and on this thread: a
    // lock is biased to one executor in all its life. The lock is held, so the wake is taken once.
    // From here on the node is noted nowhere, as `depart` demands.
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
/// The lists are those of `wait_point`, and the value was moved. The partner's node was committed,
/// is not settled, and is in no list, or is the entry of a registered alternative. `ready` is its
/// wake, made in a plain turn on this thread.
#[inline(always)]
pub(super) unsafe fn depart<const SEND: bool>(
    wait_point: &WaitPoint,
    mut lists: InsideGuard<'_, WaitQueues>,
    (partner, ready): (NonNull<WaitNode>, PlainPendingWake),
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the partner was committed and taken off under the lock that is still held, and its
    // value was moved, so it is `Done`, as `set_outcome` demands. Its wake was made in a plain
    // turn on this thread, which has left the lock when it wakes.
    unsafe {
        lists.note_user(SEND, LastUser::process(turn.process().id()));
        Waiter::<()>::set_outcome(partner.cast(), Outcome::Done);
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
    // SAFETY: the handle was made in a plain turn on this thread, as is demanded here: all that the
    // wake demands.
    unsafe {
        match ready.wake_if_none_ready(turn) {
            Ok(()) => FastPath::Done,
            Err(ready) => wake_otherwise(ready, turn),
        }
    }
}

/// As the rest of [`part`].
///
/// # Safety
///
/// `ready` was made in a plain turn on this thread, which holds no lock.
#[cold]
#[inline(never)]
unsafe fn part_revoked(
    wait_point: &WaitPoint,
    ready: PlainPendingWake,
    turn: PlainTurn<'_>,
) -> FastPath {
    wait_point.after_revocation();
    // SAFETY: `ready` was made in a plain turn on this thread, as is demanded here.
    unsafe { wake_otherwise(ready, turn) }
}

/// Readies the partner, whatever is ready already.
///
/// # Safety
///
/// `ready` was made in a plain turn on this thread, which holds no lock.
#[inline(never)]
unsafe fn wake_otherwise(ready: PlainPendingWake, turn: PlainTurn<'_>) -> FastPath {
    // SAFETY: `ready` was made in a plain turn on this thread, as is demanded here: all that the
    // wake demands.
    unsafe {
        ready.fetch();
        ready.wake();
        FastPath::done(turn)
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

/// Moves the value between a plain guard, which its alternative has chosen, and the partner that
/// waits alone for it, and lets that go. The guard's node is done.
///
/// # Safety
///
/// The lock of `wait_point`, of a live channel, was kept, and is not taken back elsewhere. `node`
/// is that of a new plain operation of this side there, and a partner waits alone for it.
#[inline(always)]
pub(crate) unsafe fn meet_alone(
    wait_point: &WaitPoint,
    node: NonNull<Waiter<()>>,
    by_sender: bool,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: as is demanded here.
    unsafe {
        match by_sender {
            true => meet_met::<true>(wait_point, node, turn),
            false => meet_met::<false>(wait_point, node, turn),
        }
    }
}

/// # Safety
///
/// As for [`meet_alone`].
#[inline(never)]
unsafe fn meet_met<const SEND: bool>(
    wait_point: &WaitPoint,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the lock was kept, and is taken back once. A partner waits alone there, as
    // `move_value` and `part` demand. The new node is known to its future alone.
    unsafe {
        let lists = wait_point.kept(turn);
        let partner = lists.waiting.one(!SEND).unwrap_unchecked();
        move_value::<SEND>(wait_point, node, partner);
        Waiter::settle_new(node);
        part::<SEND>(wait_point, lists, partner, turn)
    }
}

impl<T> Channel<T> {
    /// Stores the value of a sender, if there is room.
    ///
    /// # Safety
    ///
    /// As for [`Meet`], of a send at a channel with a buffer where nothing waits.
    pub(super) unsafe fn store_fast(
        channel: NonNull<WaitPoint>,
        node: NonNull<Waiter<()>>,
        turn: PlainTurn<'_>,
    ) -> FastPath {
        // SAFETY: `channel` leads to a whole channel of values of this type, whose first field is
        // the wait point, and the operation's end keeps it; the node is one of this type: `Meet`
        // demands that. This thread has kept the lock, which guards the store too, and takes it
        // back once. A new send's node holds a value. The store of such a buffer was made with room
        // for all that the buffer holds, and one that is not full has room for one more.
        unsafe {
            let this = channel.cast::<Self>().as_ref();
            let is_stored = this.store.with_mut(|store| {
                let store = &mut *store;
                if store.len() >= this.capacity() {
                    return false;
                }
                assert_unchecked(store.len() < store.capacity());
                store.push_back(Waiter::take_value_of(node.cast::<Waiter<T>>()));
                true
            });
            if !is_stored {
                return FastPath::Inside;
            }
            let mut lists = this.wait_point.kept(turn);
            lists.note_user(true, LastUser::process(turn.process().id()));
            lists.is_storing = true;
            leave_done(&this.wait_point, lists, turn)
        }
    }

    /// Receives a stored value, or lets the receiver wait.
    ///
    /// # Safety
    ///
    /// As for [`Meet`], of a receive at a channel with a buffer where nothing waits.
    pub(super) unsafe fn take_stored_fast(
        channel: NonNull<WaitPoint>,
        node: NonNull<Waiter<()>>,
        turn: PlainTurn<'_>,
    ) -> FastPath {
        // SAFETY: `channel` leads to a whole channel of values of this type, whose first field is
        // the wait point, and the operation's end keeps it; the node is one of this type: `Meet`
        // demands that. This thread has kept the lock, which guards the store too, and takes it
        // back once. Where a value is stored, `pop_front` returns one. A new receive's node holds
        // none, and only its future knows it. Else nothing waits, as `wait_for_value` demands,
        // which takes the lock back in this function's stead. It is taken back late: one register
        // less is in use while the value moves.
        unsafe {
            let this = channel.cast::<Self>().as_ref();
            let stored = this.store.with(|store| (*store).len());
            if stored == 0 {
                return wait_for_value(channel, node, turn);
            }
            let value = this.store.with_mut(|store| (*store).pop_front());
            Waiter::put_value_of(node.cast::<Waiter<T>>(), value.unwrap_unchecked());
            let mut lists = this.wait_point.kept(turn);
            lists.note_user(false, LastUser::process(turn.process().id()));
            lists.is_storing = stored > 1;
            leave_done(&this.wait_point, lists, turn)
        }
    }
}

/// The rest of [`Channel::take_stored_fast`] where nothing is stored.
///
/// # Safety
///
/// As for [`Meet`], of a receive at a channel with a buffer where nothing waits.
#[inline(never)]
unsafe fn wait_for_value(
    channel: NonNull<WaitPoint>,
    node: NonNull<Waiter<()>>,
    turn: PlainTurn<'_>,
) -> FastPath {
    // SAFETY: the lock was kept, and is taken back once; nothing waits.
    unsafe {
        let plain = Plain::<false>::new(channel, node, turn);
        plain.wait_alone(plain.wait_point().kept(turn))
    }
}

/// Counts what the prologue has completed, for tests that mean it.
#[cfg(test)]
pub(crate) mod taken {
    use super::FastPath;
    use core::sync::atomic::{AtomicUsize, Ordering};

    static TAKEN: AtomicUsize = AtomicUsize::new(0);

    pub(super) fn note(met: FastPath) {
        if !matches!(met, FastPath::Inside | FastPath::No) {
            TAKEN.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// How many operations the prologue has completed, or has let wait, in this program.
    pub(crate) fn count() -> usize {
        TAKEN.load(Ordering::Relaxed)
    }
}

#[cfg(all(test, feature = "std", not(loom), target_os = "linux"))]
mod tests;
