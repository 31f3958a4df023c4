//! The second level: a group on one executor that is one party of a barrier.
//!
//! The member that completes the group goes to the barrier for all: the group's own `sync` lies in
//! the group, and that member comes with it. When a member leaves meanwhile, the group is not
//! complete any more, and its coming is withdrawn, unless the barrier's round is over already.
//!
//! Wakers are user code: their clones, wakes and drops may poll and drop members of the same group.
//! So none of that happens between two steps of one change. When a round of the barrier is
//! complete, it is also complete for the group before the first waker is woken. From there on, a
//! member that is dropped has come, and a member that is polled first belongs to the next round.

use super::sync::Came;
use super::{Barrier, SyncOp};
use crate::finally::Finally;
use luna_core::current::{self, ExecutorId, Renewal, WakeHandle};
use luna_core::deferred_free::Shared;
use luna_core::wait_list::{WaitList, WaitNode};
use std::cell::UnsafeCell;
use std::fmt;
use std::future::Future;
use std::marker::{PhantomData, PhantomPinned};
use std::pin::Pin;
use std::ptr::NonNull;
use std::sync::OnceLock;
use std::task::{Context, Poll};

/// A group of processes of one executor that is one party of a barrier: see [`Barrier::local`].
///
/// Among themselves the members use no atomics. The group belongs to the thread that syncs first;
/// its handles may be cloned and sent before that.
#[derive(Clone)]
pub struct LocalBarrier {
    group: Shared<Group>,
}

/// # Invariants
///
/// `state` and `global` are accessed by the thread of this executor alone, once that is set.
/// Nodes in the lists are those of pinned [`LocalSync`]s, which stay on that thread. `global`
/// borrows `barrier`, and stays where it is while it is there.
struct Group {
    /// Dropped before what it borrows.
    global: UnsafeCell<Option<SyncOp<'static>>>,
    state: UnsafeCell<State>,
    parties: usize,
    executor: OnceLock<ExecutorId>,
    barrier: Barrier,
}

struct State {
    /// How many are in `waiting`.
    arrived: usize,
    waiting: WaitList,
    /// Members of a completed round, while they are woken.
    releasing: WaitList,
    /// Number of completed rounds.
    number: u32,
}

// SAFETY: by the type's invariant only one thread accesses the cells.
unsafe impl Send for Group {}
// SAFETY: as above.
unsafe impl Sync for Group {}

impl LocalBarrier {
    pub(super) fn new(barrier: Barrier, parties: usize) -> Self {
        Self {
            group: Shared::new(Group {
                global: UnsafeCell::new(None),
                state: UnsafeCell::new(State {
                    arrived: 0,
                    waiting: WaitList::new(),
                    releasing: WaitList::new(),
                    number: 0,
                }),
                parties,
                executor: OnceLock::new(),
                barrier,
            }),
        }
    }

    /// Comes to the barrier as a member of the group, and waits until all members and all other
    /// parties have come.
    ///
    /// The future is not `Send`: a process that awaits it is built where it runs, by a closure. In
    /// a branch of a parallel construct, after a sibling has failed, it does not wait: the branch
    /// ends there. Cancel-safe, as [`Barrier::sync`]. Real-time path: yes; O(1), and O(parties of
    /// the group) for the last one, which also pays for the barrier's own `sync`.
    ///
    /// # Panics
    ///
    /// When first polled on another thread than that of the group, or where no process of LUNA
    /// runs.
    pub fn sync(&self) -> LocalSync<'_> {
        LocalSync {
            group: &self.group,
            node: UnsafeCell::new(Node {
                wait: WaitNode::new(),
                round: 0,
                is_listed: false,
            }),
            phase: Phase::New,
            _pinned: PhantomPinned,
            _stays_here: PhantomData,
        }
    }
}

impl Group {
    fn state(&self) -> *mut State {
        self.state.get()
    }

    /// # Panics
    ///
    /// Where the group does not belong.
    fn enter(&self) {
        let here = current::executor_id().expect(
            "a local barrier was awaited on a thread that runs no LUNA process: use the barrier itself there",
        );
        assert!(
            *self.executor.get_or_init(|| here) == here,
            "a local barrier was awaited on two threads: its group belongs to the executor of its first sync; use the barrier itself elsewhere"
        );
    }

    /// Goes to the barrier for all, or sees how that stands. Called on the group's thread, when the
    /// group is complete. Runs no user code. The renewal has a handle.
    fn come(&self, renewal: &mut Renewal<'_, '_>) -> After<'_> {
        // SAFETY: this is the group's thread. The operation borrows the barrier, which lies in the
        // group's own allocation and is dropped after it; it is not moved while it is there, and is
        // taken out as soon as its round is complete.
        let came = unsafe {
            let global = &mut *self.global.get();
            if global.is_none() {
                self.barrier.meeting.note_user();
            }
            let sync = global.get_or_insert_with(|| {
                let barrier: *const Barrier = &raw const self.barrier;
                (*barrier).sync()
            });
            sync.look(renewal)
        };
        let (is_complete, completes, former) = match came {
            Came::Waits => (false, false, None),
            Came::Completes => (true, true, None),
            Came::IsOver(former) => (true, false, former),
        };
        if is_complete {
            self.complete();
        }
        After {
            group: self,
            completes,
            is_complete,
            former: [former, None],
        }
    }

    /// Completes the round: all that wait are to be woken. Called on the group's thread. Runs no
    /// user code.
    fn complete(&self) {
        // SAFETY: this is the group's thread. The operation is over, so that it has no wake handle
        // any more that its drop could drop.
        unsafe {
            *self.global.get() = None;
            let state = self.state();
            (*state).arrived = 0;
            (*state).number = (*state).number.wrapping_add(1);
            (*state).releasing.append(&mut (*state).waiting);
        }
    }

    fn ready_all(&self) {
        loop {
            // SAFETY: this is the group's thread; the nodes in the list are live.
            let wake_handle = unsafe {
                let Some(node) = (*self.state()).releasing.pop() else {
                    return;
                };
                let node = node.cast::<Node>().as_ptr();
                (*node).is_listed = false;
                (*node).wait.wake_handle_mut().take()
            };
            // A wake may panic: the remaining wakes must still be done.
            let rest = Finally::new(|| self.ready_all());
            if let Some(wake_handle) = wake_handle {
                wake_handle.take().wake();
            }
            rest.cancel();
        }
    }

    /// Called before a waiting member leaves: the group is not complete, and has not come, unless
    /// the barrier's round is over. Runs no user code.
    fn withdraw(&self) -> After<'_> {
        // SAFETY: this is the group's thread, and the borrow ends before `complete`.
        let taken_back = unsafe { &mut *self.global.get() }
            .as_mut()
            .map(SyncOp::take_back);
        let (is_complete, former) = taken_back.unwrap_or_default();
        if is_complete {
            self.complete();
        } else {
            // SAFETY: this is the group's thread. What was taken back has no wake handle any more
            // that its drop could drop.
            unsafe { *self.global.get() = None };
        }
        After {
            group: self,
            completes: false,
            is_complete,
            former: [former, None],
        }
    }

    /// Whether all members have come, and wait.
    fn is_complete(&self) -> bool {
        // SAFETY: this is the group's thread.
        unsafe { (*self.state()).arrived >= self.parties }
    }
}

/// Remaining work after a change of the group: all that may run user code.
#[must_use]
struct After<'a> {
    group: &'a Group,
    /// The barrier's other parties are to be released.
    completes: bool,
    /// The round is complete; its members are to be woken.
    is_complete: bool,
    former: [Option<WakeHandle>; 2],
}

impl After<'_> {
    /// Also if a waker panics, all are woken.
    fn carry_out(self) {
        let wake_members = || self.group.ready_all();
        let members = self.is_complete.then(|| Finally::new(wake_members));
        if self.completes {
            self.group.barrier.meeting.release();
        }
        drop(members);
        drop(self.former);
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    New,
    /// In one of the group's lists, or released.
    Waiting,
    /// The round is complete, and this member has completed the barrier's; the process lets others
    /// run before it continues.
    GaveWay,
    Over,
}

#[repr(C)]
struct Node {
    /// First, so that the list's node leads back to this.
    wait: WaitNode,
    /// The round that it waits in.
    round: u32,
    is_listed: bool,
}

/// Coming to a barrier as one of a group: see [`LocalBarrier::sync`].
#[must_use = "an operation does nothing unless awaited"]
pub struct LocalSync<'a> {
    group: &'a Group,
    node: UnsafeCell<Node>,
    phase: Phase,
    _pinned: PhantomPinned,
    _stays_here: PhantomData<*const ()>,
}

impl LocalSync<'_> {
    fn node(&self) -> NonNull<Node> {
        // SAFETY: a cell's address is never null.
        unsafe { NonNull::new_unchecked(self.node.get()) }
    }

    /// Whether the round that it waits in is complete.
    fn is_through(&self) -> bool {
        // SAFETY: this future stays on the group's thread, which alone changes the node.
        unsafe { (*self.node().as_ptr()).round != (*self.group.state()).number }
    }

    /// Takes a waiting member back, if its round is not complete. Returns whether the round is
    /// complete. Runs no user code.
    fn leave(&mut self) -> (bool, After<'_>) {
        let mut after = match self.is_through() {
            false => self.group.withdraw(),
            true => After {
                group: self.group,
                completes: false,
                is_complete: false,
                former: [None, None],
            },
        };
        let is_through = self.is_through();
        // SAFETY: as above; a listed node is in the list that the round's number says.
        unsafe {
            let (node, state) = (self.node().as_ptr(), self.group.state());
            if (*node).is_listed {
                (*node).is_listed = false;
                if is_through {
                    (*state).releasing.remove(self.node().cast());
                } else {
                    (*state).waiting.remove(self.node().cast());
                    (*state).arrived -= 1;
                }
            }
            after.former[1] = (*node).wait.wake_handle_mut().take();
        }
        (is_through, after)
    }

    /// Goes to the barrier for the group, if the group is complete. Returns whether this member has
    /// completed the barrier's round.
    fn come_for_all(&self, cx: &Context<'_>) -> bool {
        let is_due = || !self.is_through() && self.group.is_complete();
        if !is_due() {
            return false;
        }
        // Cloning a waker is user code: its effects are looked at afterwards.
        let mut renewal = Renewal::made(cx);
        if !is_due() {
            return false;
        }
        let after = self.group.come(&mut renewal);
        let completes = after.completes;
        after.carry_out();
        completes
    }

    /// Comes to the group. Cloning the waker is user code, and comes first.
    fn enter(&mut self, cx: &Context<'_>) {
        self.group.enter();
        let wake_handle = WakeHandle::of(cx);
        // SAFETY: this is the group's thread; the node is in no list, pinned, and taken off before
        // it goes.
        unsafe {
            let (node, state) = (self.node().as_ptr(), self.group.state());
            (*node).round = (*state).number;
            (*node).is_listed = true;
            (*state)
                .waiting
                .insert(self.node().cast(), current::priority(), wake_handle);
            (*state).arrived += 1;
        }
        self.phase = Phase::Waiting;
    }

    /// Is to be woken by `cx` from now on.
    fn renew(&mut self, cx: &Context<'_>) {
        // SAFETY: this future stays on the group's thread, which alone changes the node; no borrow
        // of it is left while user code runs.
        let wake_handle = || unsafe { (*self.node().as_ptr()).wait.wake_handle_mut() };
        if wake_handle().as_ref().is_some_and(|known| known.is_of(cx)) {
            return;
        }
        let mut new = Some(WakeHandle::of(cx));
        // The clone may have completed the round.
        if !self.is_through() {
            std::mem::swap(wake_handle(), &mut new);
        }
        drop(new);
    }
}

impl Future for LocalSync<'_> {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        // SAFETY: nothing pinned is moved.
        let this = unsafe { self.get_unchecked_mut() };
        assert!(
            this.phase != Phase::Over,
            "a sync was polled after it was over"
        );
        if this.phase == Phase::GaveWay {
            this.phase = Phase::Over;
            return Poll::Ready(());
        }
        if current::branch_failed() {
            let mut has_come = false;
            if std::mem::replace(&mut this.phase, Phase::New) == Phase::Waiting {
                let (is_through, after) = this.leave();
                has_come = is_through;
                after.carry_out();
            }
            if has_come {
                this.phase = Phase::Over;
                return Poll::Ready(());
            }
            current::end_branch(cx);
            return Poll::Pending;
        }
        if this.phase == Phase::New {
            this.enter(cx);
        } else if !this.is_through() {
            this.renew(cx);
        }
        let completes = this.come_for_all(cx);
        if !this.is_through() {
            this.group.barrier.meeting.waits();
            return Poll::Pending;
        }
        // It may be on its way to being woken.
        this.phase = Phase::Over;
        this.leave().1.carry_out();
        if completes && crate::yield_after_operation(cx) {
            this.phase = Phase::GaveWay;
            return Poll::Pending;
        }
        Poll::Ready(())
    }
}

impl Drop for LocalSync<'_> {
    fn drop(&mut self) {
        if self.phase == Phase::Waiting {
            self.group.barrier.meeting.waits_no_more();
            self.leave().1.carry_out();
        }
    }
}

impl fmt::Debug for LocalBarrier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LocalBarrier")
            .field("parties", &self.group.parties)
            .finish_non_exhaustive()
    }
}

impl fmt::Debug for LocalSync<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LocalSync")
            .field("phase", &self.phase)
            .finish_non_exhaustive()
    }
}
