//! What waits at a wait point, and what its lock guards.

use super::Ending;
use crate::core::Nodes;
use crate::ended::Watcher;
use crate::replay::{LogState, Order};
use crate::waiter::Waiter;
use core::ptr::NonNull;
use luna_core::current::{Inheritor, ProcessId, User};
use luna_core::wait_list::{WaitList, WaitNode};
use luna_core::waiting::OpList;

/// What waits at a wait point, as one word that the fast path decides by.
///
/// One plain operation may wait outside of the queues: it is *alone*, and its node has a wake
/// handle and nothing else. So may one that is a guard of an alternative: its node leads to the
/// select state, which has the wake handle. Before anything else is done here, the slow path
/// [lists](WaitQueues::list_lone) it.
///
/// ```text
///   IDLE, STORE or REGISTERED <---> alone, sender or receiver
///     |      ^                           |
///     |      '-- fast path: plain, and both queues are empty
///     v                                  v
///   QUEUES <--- slow path, with each lock
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Waiting(*mut WaitNode);

// SAFETY: it owns no node; the lock that guards it guards the node too, so it may go where the lock
// goes.
unsafe impl Send for Waiting {}

impl Waiting {
    /// Nothing waits at an unbuffered channel, which is used for plain operations only.
    pub(super) const IDLE: u8 = 0;
    /// Nothing waits at a buffered channel, which is used for plain operations only. There may be
    /// stored values.
    const STORE: u8 = 4;
    /// As `IDLE`, at a channel where one alternative is registered: no receiver waits alone here.
    pub(crate) const REGISTERED: Waiting = Waiting::special(7);
    /// See the queues.
    pub(crate) const QUEUES: Waiting = Waiting::special(3);
    const SENDER: usize = 1;
    const RECEIVER: usize = 2;
    /// Beside the side: it is a guard.
    const GUARD: usize = 4;
    /// The bits in which a node's address is 0.
    const TAG: usize = 7;

    const fn special(number: u8) -> Self {
        Self(core::ptr::without_provenance_mut(number as usize))
    }

    const fn tag(of_sender: bool) -> usize {
        match of_sender {
            true => Self::SENDER,
            false => Self::RECEIVER,
        }
    }

    #[inline(always)]
    fn tagged(node: NonNull<WaitNode>, tag: usize) -> Self {
        const { assert!(align_of::<WaitNode>() > Self::TAG) };
        Self(node.as_ptr().map_addr(|address| address | tag))
    }

    #[inline(always)]
    fn node(self, tag: usize) -> Option<NonNull<WaitNode>> {
        let node = self.0.map_addr(|word| word.wrapping_sub(tag));
        // SAFETY: no special number is an operation's or a guard's tag, so what has all bits of the
        // tag clear here is the address of a node, which is not null.
        (node.addr() & Self::TAG == 0).then(|| unsafe { NonNull::new_unchecked(node) })
    }

    /// The node of the operation of this side that waits alone.
    #[inline(always)]
    pub(crate) fn one(self, is_sender: bool) -> Option<NonNull<WaitNode>> {
        self.node(Self::tag(is_sender))
    }

    /// The guard with this node waits alone.
    #[inline(always)]
    pub(crate) fn alone_guard(node: NonNull<WaitNode>, is_sender: bool) -> Self {
        Self::tagged(node, Self::GUARD | Self::tag(is_sender))
    }

    /// The node of the guard of this side that waits alone.
    #[inline(always)]
    pub(crate) fn guard(self, is_sender: bool) -> Option<NonNull<WaitNode>> {
        self.node(Self::GUARD | Self::tag(is_sender))
    }

    /// Whether nothing waits, and nothing can be stored.
    #[inline(always)]
    pub(crate) fn is_idle(self) -> bool {
        self.0.addr() == Self::IDLE as usize
    }

    /// Whether nothing waits, at a channel with a buffer.
    #[inline(always)]
    pub(crate) fn is_store(self) -> bool {
        self.0.addr() == Self::STORE as usize
    }
}

/// What a wait point's lock guards. The nodes in the lists are guarded with it.
///
/// Fields that each rendezvous writes come first, so that they lie on one cache line with the lock
/// and the hand-off slots: between two cores each line is a transfer of its own. Fields that it
/// only reads follow on the next line, which both cores can share.
#[derive(Debug)]
#[repr(C)]
pub struct WaitQueues {
    pub(crate) waiting: Waiting,
    /// Last user of each kind of end.
    pub(crate) sender: LastUser,
    pub(crate) receiver: LastUser,
    pub(crate) ending: Ending,
    /// Whether it has ended, or a recorded process has come: operations then take the slow path
    /// here. See [`find_whether_plain`](WaitQueues::find_whether_plain).
    pub(crate) is_unusual: bool,
    /// Whether the fast path may decide here. See
    /// [`find_whether_plain`](WaitQueues::find_whether_plain).
    pub(crate) is_plain: bool,
    pub(crate) may_be_plain: bool,
    /// What `waiting` is while nothing waits and the fast path decides: `STORE` where there is a
    /// buffer, else `IDLE` or `REGISTERED`.
    pub(super) nothing: u8,
    /// Whether the fast path moves a value as one word, which lies behind the link of the node.
    pub(crate) moves_word: bool,
    /// Whether an operation has ever waited to receive by extended rendezvous.
    pub(crate) extends: bool,
    /// Whether anything is stored: kept here, so that a receiver need not look beyond this line
    /// where nothing is stored.
    pub(crate) is_storing: bool,
    pub(crate) senders: WaitList,
    pub(crate) receivers: WaitList,
    /// The number of extended rendezvous so far: it distinguishes a held sender from another one at
    /// the same address.
    pub(crate) tickets: u32,
    pub(crate) order: Order,
    pub(crate) hand_off: Nodes,
    /// Alternatives that stay registered between their selections, as receivers.
    pub(crate) registered: WaitList,
    /// Last process to come to accept a call here, boosted by the most urgent client that waits.
    /// `None` once the wait point has ended.
    pub(crate) server: Option<Inheritor>,
    /// Senders with a value received by extended rendezvous, which are held until the receiver is
    /// done with it.
    pub(crate) held: WaitList,
    /// Operations that wait for the end alone: see `ended`.
    pub(crate) watching: OpList<Watcher>,
    /// What is known of recorded processes that come here.
    pub(crate) log_state: LogState,
}

/// The last user of one kind of ends, if there was any: an `Option<User>` that is one store.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LastUser(u32);

impl WaitQueues {
    /// For a channel of this kind, before its first use.
    pub(crate) fn set_up(&mut self, is_rendezvous: bool, may_be_plain: bool, moves_word: bool) {
        self.nothing = match is_rendezvous {
            true => Waiting::IDLE,
            false => Waiting::STORE,
        };
        self.may_be_plain = may_be_plain;
        self.order.is_ordered = !may_be_plain;
        self.moves_word = moves_word;
        self.find_whether_plain();
    }

    /// The operation with this node waits alone from now on.
    #[inline(always)]
    pub(crate) fn set_alone(&mut self, node: NonNull<WaitNode>, is_sender: bool) {
        self.waiting = Waiting::tagged(node, Waiting::tag(is_sender));
    }

    /// The operation that waited alone does so no more.
    #[inline(always)]
    pub(crate) fn set_nothing_waits(&mut self) {
        self.waiting = Waiting::special(self.nothing);
    }

    /// Lets the fast path decide again, if it may.
    #[inline]
    pub(crate) fn leave_queues(&mut self) -> bool {
        let may = self.waiting == Waiting::QUEUES
            && self.is_plain
            && self.senders.is_empty()
            && self.receivers.is_empty()
            && !(self.is_rendezvous() && self.is_storing);
        if may {
            self.set_nothing_waits();
        }
        may
    }

    /// Lists the operation that waits alone, if there is one: from here on the queues say all.
    #[inline(always)]
    pub(crate) fn list_lone(&mut self) {
        if self.waiting != Waiting::QUEUES {
            self.use_queues();
        }
    }

    #[inline(never)]
    fn use_queues(&mut self) {
        let waiting = self.waiting;
        for is_sender in [true, false] {
            let queue = self.queue(is_sender);
            // SAFETY: a node that waits alone is live and not settled while it is noted here, since
            // the lock that is held guards it. It was made so by `set_alone`, or begun as a guard
            // by the fast path. While one waits so the queues are empty.
            unsafe {
                if let Some(node) = waiting.one(is_sender) {
                    WaitNode::complete(node.as_ptr());
                    queue.insert_into_empty(node);
                } else if let Some(node) = waiting.guard(is_sender) {
                    Waiter::<()>::complete_guard(node.cast());
                    queue.insert_into_empty(node);
                }
            }
        }
        self.waiting = Waiting::QUEUES;
    }

    /// The queue of the operations of this side.
    #[inline(always)]
    pub(crate) fn queue(&mut self, is_sender: bool) -> &mut WaitList {
        match is_sender {
            true => &mut self.senders,
            false => &mut self.receivers,
        }
    }

    /// Whether it is plain and has no buffer, and no alternative is registered.
    #[inline]
    pub(crate) fn is_plain_rendezvous(&self) -> bool {
        self.is_plain && self.nothing == Waiting::IDLE
    }

    /// Whether it has no buffer.
    #[inline(always)]
    pub(crate) fn is_rendezvous(&self) -> bool {
        self.nothing != Waiting::STORE
    }

    /// Whether it is unbuffered, and plain but for one registered alternative.
    #[inline(always)]
    pub(crate) fn is_plain_but_registered(&self) -> bool {
        self.is_plain && Waiting::special(self.nothing) == Waiting::REGISTERED
    }

    /// Notes which user was the last one of this side.
    #[inline(always)]
    pub(crate) fn note_user(&mut self, is_sender: bool, user: LastUser) {
        match is_sender {
            true => self.sender = user,
            false => self.receiver = user,
        }
    }

    /// Whether plain sends and receives may meet on the [hand-off
    /// slots](crate::core::HandOffSlots): the wait point has no other use, and no node is listed.
    #[inline]
    pub(crate) fn may_use_hand_off_slots(&self) -> bool {
        self.is_plain_rendezvous() && self.senders.is_empty() && self.receivers.is_empty()
    }

    /// To be called after each change of what it looks at. Waiters for the end and held senders do
    /// not change what a plain operation does.
    pub(crate) fn find_whether_plain(&mut self) {
        let is_plain = self.may_be_plain
            && self.ending == Ending::Open
            && !self.extends
            && self.server.is_none()
            && !self.log_state.is_used();
        let registered = self.registered.first();
        // SAFETY: it is the first of this list.
        let is_one =
            registered.is_some_and(|first| unsafe { self.registered.after(first) }.is_none());
        // It is called under a lock that has listed what waited alone.
        debug_assert!(self.waiting == Waiting::QUEUES);
        self.is_plain = is_plain && (registered.is_none() || is_one && self.is_rendezvous());
        if self.is_rendezvous() {
            self.nothing = match registered {
                None => Waiting::IDLE,
                Some(_) => Waiting::REGISTERED.0.addr() as u8,
            };
        }
        self.is_unusual = self.ending != Ending::Open || self.log_state.is_used();
    }
}

impl LastUser {
    pub(crate) const NONE: LastUser = LastUser(u32::MAX);

    #[inline]
    pub(crate) fn of(user: User) -> Self {
        LastUser(match user {
            User::Outside => 0,
            User::Process(process) => process.get(),
        })
    }

    #[inline]
    pub(crate) fn process(process: ProcessId) -> Self {
        LastUser(process.get())
    }

    pub(crate) fn get(self) -> Option<User> {
        match self.0 {
            u32::MAX => None,
            number => Some(ProcessId::from_number(number).map_or(User::Outside, User::Process)),
        }
    }
}
