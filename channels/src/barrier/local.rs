//! The second level: a group on one executor that is one party of a barrier.
//!
//! Whoever completes the group goes to the barrier for all: the group's own `sync` lies in the group, and is polled by that member. When a member
//! leaves meanwhile, the group is not complete any more, and its coming is withdrawn, unless the barrier's round is over already.

use super::{Barrier, SyncOp};
use luna_platform::current::{self, Home, Wakeup};
use luna_platform::reclaim::Shared;
use luna_platform::wait_list::{WaitList, WaitNode};
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
/// Among themselves the members use no atomics. The group belongs to the thread that syncs first; its handles may be cloned and sent before
/// that.
#[derive(Clone)]
pub struct LocalBarrier {
    group: Shared<Group>,
}

/// # Invariants
///
/// `state` and `global` are accessed by the thread of `home` alone, once that is set. Nodes in the lists are those of pinned [`LocalSync`]s, which
/// stay on that thread. `global` borrows `barrier`, and stays where it is while it is there.
struct Group {
    /// Dropped before what it borrows.
    global: UnsafeCell<Option<SyncOp<'static>>>,
    state: UnsafeCell<State>,
    parties: usize,
    home: OnceLock<Home>,
    barrier: Barrier,
}

struct State {
    /// How many are in `waiting`.
    arrived: usize,
    waiting: WaitList,
    /// Those whose round is complete, while they are readied.
    releasing: WaitList,
    /// Counts the rounds that were completed.
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
                home: OnceLock::new(),
                barrier,
            }),
        }
    }

    /// Comes to the barrier as one of the group, and waits until all of the group and all other parties have come.
    ///
    /// The future is not `Send`: a process that awaits it is built where it runs, by a closure. In a branch of a parallel construct one of whose
    /// siblings has failed, it does not wait: the branch ends there. Cancel-safe, as [`Barrier::sync`]. Real-time path: yes; O(1), and O(parties
    /// of the group) for the last one, who also pays for the barrier's own `sync`.
    ///
    /// # Panics
    ///
    /// When first polled on another thread than that of the group, or where no process of LUNA runs.
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
        let here = current::home().expect(
            "a local barrier was awaited on a thread that runs no LUNA process: use the barrier itself there",
        );
        assert!(
            *self.home.get_or_init(|| here) == here,
            "a local barrier was awaited on two threads: its group belongs to the executor of its first sync; use the barrier itself elsewhere"
        );
    }

    /// Goes to the barrier for all, or sees how that stands. Called on the group's thread, by a member that waits, when the group is complete.
    fn poll_global(&self, cx: &mut Context<'_>) {
        // SAFETY: this is the group's thread. The operation borrows the barrier, which lies in the group's own allocation and is dropped after
        // it; it is not moved while it is there.
        let polled = unsafe {
            let global = &mut *self.global.get();
            let sync = global.get_or_insert_with(|| {
                let barrier: *const Barrier = &raw const self.barrier;
                (*barrier).sync()
            });
            Pin::new_unchecked(sync).poll(cx)
        };
        if polled.is_ready() {
            self.release();
        }
    }

    /// Completes the round, and readies all who wait. Called on the group's thread.
    fn release(&self) {
        // SAFETY: this is the group's thread, and nothing is borrowed while somebody's code runs. The operation is over.
        unsafe {
            *self.global.get() = None;
            let state = self.state();
            (*state).arrived = 0;
            (*state).number = (*state).number.wrapping_add(1);
            (*state).releasing.append(&mut (*state).waiting);
        }
        self.ready_all();
    }

    fn ready_all(&self) {
        loop {
            // SAFETY: this is the group's thread; the nodes in the list are live.
            let wakeup = unsafe {
                let Some(node) = (*self.state()).releasing.pop() else {
                    return;
                };
                let node = node.cast::<Node>().as_ptr();
                (*node).is_listed = false;
                (*node).wait.wakeup_mut().take()
            };
            // Whoever is readied: the others must not depend on that going well.
            let rest = Rest(self);
            if let Some(wakeup) = wakeup {
                wakeup.take().wake();
            }
            std::mem::forget(rest);
        }
    }

    /// A member that waited leaves: so the group is not complete, and has not come, unless the barrier's round is over. Says whether it is.
    fn withdraw(&self) -> bool {
        // SAFETY: this is the group's thread.
        let global = unsafe { &mut *self.global.get() };
        let Some(sync) = global else {
            return false;
        };
        if sync.leave() {
            self.release();
            return true;
        }
        *global = None;
        false
    }
}

/// The rest of a release, if somebody's waker panics in the middle of it.
struct Rest<'a>(&'a Group);

impl Drop for Rest<'_> {
    fn drop(&mut self) {
        self.0.ready_all();
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    New,
    /// In one of the group's lists, or released.
    Waiting,
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

    /// Takes one that waits back, if its round is not complete. Says whether it is.
    fn leave(&mut self) -> bool {
        let is_through = self.is_through() || self.group.withdraw();
        // SAFETY: as above; a listed node is in the list that the round's number says.
        let former = unsafe {
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
            (*node).wait.wakeup_mut().take()
        };
        // Somebody's code, so with nothing borrowed.
        drop(former);
        is_through
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
        if current::branch_failed() && !(this.phase == Phase::Waiting && this.leave()) {
            this.phase = Phase::New;
            current::end_branch(cx);
            return Poll::Pending;
        }
        if this.phase == Phase::New {
            this.group.enter();
            let wakeup = Wakeup::of(cx);
            // SAFETY: this is the group's thread; the node is in no list, pinned, and taken off before it goes.
            unsafe {
                let (node, state) = (this.node().as_ptr(), this.group.state());
                (*node).round = (*state).number;
                (*node).is_listed = true;
                (*state)
                    .waiting
                    .insert(this.node().cast(), current::priority(), wakeup);
                (*state).arrived += 1;
            }
            this.phase = Phase::Waiting;
        } else if !this.is_through() {
            // SAFETY: this future stays on the group's thread.
            let former = unsafe {
                let wakeup = (*this.node().as_ptr()).wait.wakeup_mut();
                match wakeup {
                    Some(known) if known.is_of(cx) => None,
                    _ => wakeup.replace(Wakeup::of(cx)),
                }
            };
            // Somebody's code, so with nothing borrowed.
            drop(former);
        }
        // SAFETY: this is the group's thread.
        if !this.is_through() && unsafe { (*this.group.state()).arrived } >= this.group.parties {
            this.group.poll_global(cx);
        }
        if !this.is_through() {
            this.group.barrier.shared().place.waits();
            return Poll::Pending;
        }
        // It may be on its way to being readied.
        this.leave();
        this.phase = Phase::Over;
        Poll::Ready(())
    }
}

impl Drop for LocalSync<'_> {
    fn drop(&mut self) {
        if self.phase == Phase::Waiting {
            self.group.barrier.shared().place.waits_no_more();
            self.leave();
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
