//! Fast path of alternatives, independent of the types of values: all guards are plain operations,
//! and the locks of all their wait points are biased to this executor.
//!
//! The decision is made as in [`choose`](super::choose): under the locks of all wait points that
//! are looked at. They are taken by plain stores and in no particular order: a thread that wants a
//! lock which this thread is inside waits until it is left, and this thread waits for no other in
//! between.
//!
//! ```text
//!   owner:    look at each --one is ready--> leave the others, move the value, let the partner go
//!                 |
//!                 '--none--> open the select state, list each guard and leave its wait point
//!   partner:  finds a guard: commits its select state, moves the value, settles the guard
//!   owner:    withdraws the other guards
//! ```
//!
//! Where nothing else waits, a guard waits alone, outside of the queues: see
//! [`Waiting`](crate::wait_point::Waiting).

use super::guard::Guard;
use crate::core::{FastPath, part_alone, part_queued};
use crate::select_state::SelectState;
use crate::stamp::Stamp;
use crate::wait_point::{LastUser, WaitPoint, WaitQueues, Waiting};
use crate::waiter::{Outcome, Waiter};
use core::pin::Pin;
use core::ptr::NonNull;
use luna_core::biased_lock::InsideGuard;
use luna_core::current::{PlainPendingWake, PlainTurn};
use luna_core::wait_list::{WaitList, WaitNode};

/// A guard on the fast path: a plain send or receive, of which the value does not matter.
#[derive(Debug, Clone, Copy)]
pub struct PlainGuard<'a> {
    pub(crate) wait_point: &'a WaitPoint,
    /// The first field of the guard's waiter.
    pub(crate) node: NonNull<WaitNode>,
    pub(crate) of_sender: bool,
    /// Stamp of its end.
    pub(crate) stamp: &'a Stamp,
}

/// A step on each guard of a list. The guards are those of one alternative, and this is the plain
/// turn of its process.
pub trait Visit {
    /// Goes to a guard. Returns whether to go on to the next one.
    fn visit<G: Guard>(&mut self, number: u32, guard: Pin<&mut G>) -> bool;
}

/// The last step on the guard that an alternative has chosen.
///
/// A build without optimization keeps each copy of an output in the frame of the function that makes
/// it. So what returns an output is inlined with optimization alone, or the frame of the poll would
/// hold the copies of all.
pub trait Finish {
    /// The output of the guard, if it is over.
    ///
    /// # Safety
    ///
    /// The guard was chosen, and its output was not taken yet. The steps say what else they demand.
    unsafe fn finish<G: Guard>(self, guard: Pin<&mut G>) -> Option<G::Output>;
}

/// The greatest stamp among the ends of an alternative, if it is fair; else no end has one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ends<const FAIR: bool> {
    greatest: u64,
}

impl<const FAIR: bool> Ends<FAIR> {
    pub(super) const fn new() -> Self {
        Self { greatest: 0 }
    }

    /// Notes an end; returns when it was last chosen.
    #[inline(always)]
    fn note(&mut self, stamp: &Stamp) -> u64 {
        if !FAIR {
            return 0;
        }
        let stamp = stamp.get();
        self.greatest = self.greatest.max(stamp);
        stamp
    }

    /// Gives the chosen end its new stamp, after all were noted.
    #[inline(always)]
    fn choose(self, chosen: &Stamp) {
        if FAIR {
            chosen.choose(self.greatest);
        }
    }
}

/// Looks at new guards, and keeps the locks of those that it has seen. A guard that comes behind a
/// ready one, in the order of preference, cannot be chosen: it is not looked at.
#[derive(Debug)]
pub(super) struct Looks<'a, const FAIR: bool> {
    turn: PlainTurn<'a>,
    /// The number of the guard to choose; or `NONE`, or `REFUSED`.
    found: u32,
    /// When the end of `ready` was last chosen.
    least: u64,
    pub(super) ends: Ends<FAIR>,
    /// A bit for each guard with a locked wait point.
    locked: u32,
}

/// What [`Looks`] have found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Found {
    /// The guard of this number is ready.
    Ready(u32),
    /// No guard is ready.
    Nothing,
    /// Fast path unavailable: no guard is there, or one cannot take it.
    Refused,
}

impl<'a, const FAIR: bool> Looks<'a, FAIR> {
    // As numbers of guards, so that one word holds what was found.
    const NONE: u32 = u32::MAX;
    const REFUSED: u32 = u32::MAX - 1;

    #[inline(always)]
    pub(super) fn new(turn: PlainTurn<'a>) -> Self {
        Self {
            turn,
            found: Self::NONE,
            least: u64::MAX,
            ends: Ends::new(),
            locked: 0,
        }
    }

    #[inline(always)]
    pub(super) fn found(&self) -> Found {
        match self.found {
            Self::REFUSED => Found::Refused,
            Self::NONE if self.locked == 0 => Found::Refused,
            Self::NONE => Found::Nothing,
            number => Found::Ready(number),
        }
    }

    /// What releases the locks, but for the lock of the guard that is ready.
    #[inline(always)]
    pub(super) fn leaving(&self) -> Leaving<'_> {
        Leaving {
            turn: self.turn,
            locked: match self.found() {
                Found::Ready(ready) => self.locked & !(1 << ready),
                _ => self.locked,
            },
        }
    }

    /// What lets the guard that is ready meet its partner.
    #[inline(always)]
    pub(super) fn meeting(&self) -> Meeting<'_, FAIR> {
        Meeting {
            turn: self.turn,
            ends: self.ends,
        }
    }
}

impl<const FAIR: bool> Visit for Looks<'_, FAIR> {
    #[inline(always)]
    fn visit<G: Guard>(&mut self, number: u32, guard: Pin<&mut G>) -> bool {
        let guard = guard.plain();
        let stamp = self.ends.note(guard.stamp);
        // Of two that were never chosen, the first.
        if stamp >= self.least {
            return true;
        }
        let Some(lists) = guard.wait_point.enter_if_free(self.turn) else {
            self.found = Self::REFUSED;
            return false;
        };
        let is_ready = if lists.waiting.is_idle() {
            lists.keep();
            false
        } else if lists.waiting.one(!guard.of_sender).is_some() {
            lists.keep();
            true
        } else {
            // SAFETY: the lists are those of the guard's wait point: it was entered for them.
            let Some(found) = (unsafe { look_at_queues(lists, guard.of_sender) }) else {
                self.found = Self::REFUSED;
                return false;
            };
            found
        };
        self.locked |= 1 << number;
        if !is_ready {
            return true;
        }
        self.least = stamp;
        self.found = number;
        FAIR
    }
}

/// Whether there is a partner, where neither nothing nor a partner waits alone. `None`: fast path
/// unavailable, and the lock is released. Else it is kept.
///
/// # Safety
///
/// The lists are those of a wait point.
#[cold]
#[inline(never)]
unsafe fn look_at_queues(mut lists: InsideGuard<'_, WaitQueues>, of_sender: bool) -> Option<bool> {
    // What a buffer stores, and a guard of another alternative on the other side, are left to the
    // slow path.
    if !lists.is_plain_rendezvous()
        || !lists.leave_queues() && (lists.is_storing || lists.waiting.guard(!of_sender).is_some())
    {
        return None;
    }
    let partner = first_partner(&mut lists, of_sender);
    // SAFETY: under the lock the nodes in the queues are accessible.
    if partner.is_some_and(|first| !unsafe { Waiter::<()>::has_plain_wake_handle(first.cast()) }) {
        return None;
    }
    lists.keep();
    Some(partner.is_some())
}

/// The first in the queue of the other side.
fn first_partner(lists: &mut WaitQueues, of_sender: bool) -> Option<NonNull<WaitNode>> {
    match of_sender {
        true => lists.waiting_for::<true>().first(),
        false => lists.waiting_for::<false>().first(),
    }
}

/// Lets the guard that is ready meet its partner, and the partner go. It is over, unless the process
/// gives way. Demands that [`Looks`] have found this guard ready, and have kept its lock.
#[derive(Debug)]
pub(super) struct Meeting<'a, const FAIR: bool> {
    turn: PlainTurn<'a>,
    ends: Ends<FAIR>,
}

impl<const FAIR: bool> Finish for Meeting<'_, FAIR> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    unsafe fn finish<G: Guard>(self, mut guard: Pin<&mut G>) -> Option<G::Output> {
        let PlainGuard {
            wait_point,
            of_sender,
            stamp,
            ..
        } = guard.plain();
        self.ends.choose(stamp);
        // The end that the guard borrows keeps the wait point.
        let wait_point = NonNull::from(wait_point);
        // SAFETY: the look has kept the lock, on this thread, and has found the partner. It is met,
        // so the guard is done.
        unsafe {
            let wait_point = wait_point.as_ref();
            let mut lists = wait_point.kept(self.turn);
            let result = match lists.waiting.one(!of_sender) {
                Some(partner) => {
                    lists.keep();
                    guard.as_mut().meet(partner);
                    part_alone(wait_point, partner, of_sender, self.turn)
                }
                None => {
                    let Some(partner) = first_partner(&mut lists, of_sender) else {
                        unreachable!("a partner has gone under the lock");
                    };
                    lists.keep();
                    guard.as_mut().meet(partner);
                    part_queued(wait_point, of_sender, self.turn)
                }
            };
            (result != FastPath::GaveWay).then(|| guard.output_when_done())
        }
    }
}

/// Releases the locks that [`Looks`] have kept, but for one.
#[derive(Debug)]
pub(super) struct Leaving<'a> {
    turn: PlainTurn<'a>,
    locked: u32,
}

impl Visit for Leaving<'_> {
    #[inline(always)]
    fn visit<G: Guard>(&mut self, number: u32, guard: Pin<&mut G>) -> bool {
        if self.locked & (1 << number) != 0 {
            // SAFETY: the look has kept the lock, on this thread.
            drop(unsafe { guard.plain().wait_point.kept(self.turn) });
        }
        true
    }
}

/// Lists the guards, none of which is ready, and releases the locks that [`Looks`] have kept.
#[derive(Debug)]
pub(super) struct Listing<'a> {
    turn: PlainTurn<'a>,
    /// The process: read once.
    user: LastUser,
    select_state: NonNull<SelectState>,
}

impl<'a> Listing<'a> {
    /// # Safety
    ///
    /// The guards are pinned, hold their values if they are senders', and withdraw their nodes
    /// before they and the select state go.
    #[inline(always)]
    pub(super) unsafe fn of(turn: PlainTurn<'a>, select_state: NonNull<SelectState>) -> Self {
        Self {
            turn,
            user: LastUser::process(turn.process().id()),
            select_state,
        }
    }
}

impl Visit for Listing<'_> {
    #[inline(always)]
    fn visit<G: Guard>(&mut self, number: u32, guard: Pin<&mut G>) -> bool {
        let PlainGuard {
            wait_point,
            node,
            of_sender,
            ..
        } = guard.plain();
        // SAFETY: the look has kept the lock, on this thread. The node is new, so no other thread
        // knows it.
        unsafe {
            let mut lists = wait_point.kept(self.turn);
            Waiter::<()>::begin_guard_alone(node.cast(), self.select_state, number);
            lists.note_user(of_sender, self.user);
            match lists.waiting.is_idle() {
                true => lists.waiting = Waiting::alone_guard(node, of_sender),
                false => list_in_queue(&mut lists, node, of_sender),
            }
        }
        guard.note_listed();
        true
    }
}

/// Lists a guard where others of its side wait.
///
/// # Safety
///
/// The node was begun to wait alone, and is not listed. It is taken off before it goes.
#[cold]
#[inline(never)]
unsafe fn list_in_queue(lists: &mut WaitQueues, node: NonNull<WaitNode>, of_sender: bool) {
    lists.list_lone();
    // SAFETY: the node was begun as a guard and is not settled, since it was never listed; the
    // lists show that the lock is held. It is in none, and its owner takes it off before it goes,
    // as is demanded here.
    unsafe {
        Waiter::<()>::complete_guard(node.cast());
        let priority = node.as_ref().priority();
        match of_sender {
            true => lists.senders.insert(node, priority, None),
            false => lists.receivers.insert(node, priority, None),
        }
    }
}

/// Takes the output of a listed guard, if it is done; then its end gets its new stamp.
#[derive(Debug)]
pub(super) struct Chosen<const FAIR: bool> {
    /// As they were when the guards were listed. What this thread has chosen since has a smaller
    /// stamp than its next choice.
    pub(super) ends: Ends<FAIR>,
}

impl<const FAIR: bool> Finish for Chosen<FAIR> {
    #[cfg_attr(not(debug_assertions), inline(always))]
    unsafe fn finish<G: Guard>(self, guard: Pin<&mut G>) -> Option<G::Output> {
        let plain = guard.plain();
        // SAFETY: the node was begun when it was listed.
        let outcome = unsafe { Waiter::outcome(plain.node.cast::<Waiter<()>>()) };
        if outcome != Outcome::Done {
            return None;
        }
        self.ends.choose(plain.stamp);
        // SAFETY: it is done, and its output was not taken yet, as is demanded here.
        Some(unsafe { guard.output_when_done() })
    }
}

/// Withdraws the guards that were listed and not chosen. The chosen one is over.
#[derive(Debug)]
pub(super) struct Withdrawing<'a> {
    pub(super) turn: PlainTurn<'a>,
}

impl Visit for Withdrawing<'_> {
    #[inline(always)]
    fn visit<G: Guard>(&mut self, _: u32, guard: Pin<&mut G>) -> bool {
        let guard = guard.plain();
        let node = guard.node.cast::<Waiter<()>>();
        // SAFETY: the node was begun when it was listed. This thread holds no other lock of a wait
        // point, and under the lock a waiting node is listed. The chosen one is over.
        unsafe {
            if Waiter::is_waiting(node) {
                match guard.wait_point.try_enter(self.turn) {
                    Some(mut lists)
                        if lists.waiting == Waiting::alone_guard(guard.node, guard.of_sender) =>
                    {
                        lists.set_nothing_waits();
                        Waiter::settle_stale(node);
                    }
                    lists => {
                        drop(lists);
                        withdraw_queued(guard.wait_point, guard.node, guard.of_sender);
                    }
                }
            }
        }
        true
    }
}

/// Withdraws a guard that may be in a queue, if it still waits.
///
/// # Safety
///
/// It was listed at this wait point, and this is its owner.
#[cold]
#[inline(never)]
unsafe fn withdraw_queued(wait_point: &WaitPoint, node: NonNull<WaitNode>, of_sender: bool) {
    // No server is boosted by waiters here: clients' calls are no plain operations.
    let mut lists = wait_point.lock_lists();
    // SAFETY: the node was listed here, and its owner, which calls this, keeps it. The lock lists
    // one that waits alone; so under it a node that waits is in the queue of its side.
    unsafe {
        if Waiter::<()>::is_waiting(node.cast()) {
            match of_sender {
                true => lists.senders.remove(node),
                false => lists.receivers.remove(node),
            }
            Waiter::<()>::settle_stale(node.cast());
        }
    }
}

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
        let Some(_commit_lock) = select_state.commit_lock_if_biased(turn) else {
            return Commit::No;
        };
        match select_state.commit_plainly(guard) {
            Some(ready) => Commit::Chosen(ready),
            None => Commit::No,
        }
    }
}

/// Takes the first operation off a queue, and guards of alternatives that have chosen before it.
/// `None`: the first operation needs the slow path; `Some(None)`: the queue is empty. The caller
/// settles the operation.
///
/// # Safety
///
/// The queue is that of one side of a plain channel without a buffer, in whose lock this thread is.
#[inline(never)]
pub(crate) unsafe fn take_first(
    queue: &mut WaitList,
    turn: PlainTurn<'_>,
) -> Option<Option<(NonNull<WaitNode>, PlainPendingWake)>> {
    while let Some(first) = queue.first() {
        // SAFETY: the node is listed, and this thread holds the lock that guards it by its bias: so
        // it is live, and no other thread withdraws it. A stale one is settled after it was taken
        // off.
        unsafe {
            let found = match Waiter::<()>::take_plain_wake_handle(first.cast()) {
                Some(ready) => Commit::Chosen(ready),
                None => match Waiter::<()>::select_state(first.cast()) {
                    Some(select_state) => commit(select_state, turn),
                    None => Commit::No,
                },
            };
            match found {
                Commit::Chosen(ready) => {
                    queue.remove_first(first);
                    return Some(Some((first, ready)));
                }
                Commit::Stale => {
                    queue.remove_first(first);
                    Waiter::<()>::settle_stale(first.cast());
                }
                Commit::No => return None,
            }
        }
    }
    Some(None)
}
