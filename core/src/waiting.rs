//! Waiting in a list under a lock, without a value and without a priority of its own: the one
//! operation behind waits for an end, for a file and for the safe state. A [`Kind`] says what it
//! waits for.
//!
//! ```text
//!        attempt            taken off by another thread          attempt, or `settled`
//!   new ---------> listed ------------------------------> settled --------------------> output
//!    |               |                                       |
//!    '--> output     '--> withdrawn: dropped <---------------'
//! ```
//!
//! An [`OpList`] holds operations alone, so the side that takes them off and wakes them is safe. No
//! user code runs under the lock: wakers are cloned and dropped outside of it (see [`Renewal`]),
//! and [`OpList::take`] returns a wake to be carried out after it.

use crate::current::{self, PendingWake, Renewal, User, WakeHandle};
use crate::events;
use crate::wait_list::{WaitList, WaitNode};
use core::cell::UnsafeCell;
use core::future::Future;
use core::marker::{PhantomData, PhantomPinned};
use core::mem::MaybeUninit;
use core::ops::DerefMut;
use core::pin::Pin;
use core::ptr::NonNull;
use core::task::{Context, Poll};

/// What an operation waits for.
///
/// # Safety
///
/// [`lock`](Self::lock) takes the same lock each time, and [`list`](Self::list) is the same list,
/// which that lock guards: also after a change by [`Op::kind_mut`]. What is called under the lock
/// runs no user code.
pub unsafe trait Kind {
    /// What the lock guards.
    type Queue;
    /// What others find in its node, under the lock.
    type Note: Copy;
    /// What it comes to.
    type Output;

    /// Takes the lock.
    fn lock(&self) -> impl DerefMut<Target = Self::Queue>;

    /// The list that it waits in.
    fn list<'q>(&self, queue: &'q mut Self::Queue) -> &'q mut OpList<Self::Note>;

    /// Under the lock, in each poll: its output, if it need not wait.
    fn attempt(&self, queue: &mut Self::Queue) -> Option<Self::Output>;

    /// Under the lock: it is about to be listed with this note, or fails.
    ///
    /// # Errors
    ///
    /// Its output, if it can not wait.
    fn begin(&self, queue: &mut Self::Queue) -> Result<Self::Note, Self::Output>;

    /// Its output, if that it was taken off its list settles it; else it makes a new attempt.
    #[inline(always)]
    fn settled(&self) -> Option<Self::Output> {
        None
    }

    /// Under the lock: it has taken itself off its list.
    #[inline(always)]
    fn withdrawn(&self, _: &mut Self::Queue) {}
}

/// The node of an operation. While it is listed the list's lock guards it.
#[repr(C)]
struct Node<N> {
    /// First, so that the list's node leads back to this.
    wait: WaitNode,
    is_listed: bool,
    note: N,
}

/// A list of waiting operations, the most urgent first.
///
/// # Invariants
///
/// Its nodes are `Node<N>`s of pinned operations, which are live while the lock that guards the
/// list is held.
#[repr(transparent)]
pub struct OpList<N>(WaitList, PhantomData<N>);

impl<N: Copy> OpList<N> {
    /// An empty list.
    pub const fn new() -> Self {
        Self(WaitList::new(), PhantomData)
    }

    /// Whether nothing waits.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// What waits, in its order: the process and its note.
    pub fn waiting(&self) -> impl Iterator<Item = (User, N)> + '_ {
        self.nodes().map(|(node, note)| {
            // SAFETY: by the invariant it is a live node; the list is borrowed from its lock.
            (unsafe { node.as_ref() }.wait.user(), note)
        })
    }

    fn nodes(&self) -> impl Iterator<Item = (NonNull<Node<N>>, N)> + '_ {
        self.0.nodes().map(|node| {
            let node = node.cast::<Node<N>>();
            // SAFETY: by the invariant it is a live node of this type; the list is borrowed from
            // its lock.
            (node, unsafe { node.as_ref() }.note)
        })
    }

    /// Takes off the most urgent operation that is meant, and returns its wake, which is to be
    /// carried out without the lock. O(those before it).
    #[inline]
    pub fn take(&mut self, meant: impl Fn(N) -> bool) -> Option<PendingWake> {
        let (node, _) = self.nodes().find(|&(_, note)| meant(note))?;
        // SAFETY: it was found in the list.
        let wake_handle = unsafe { self.remove(node) };
        Some(wake_handle.map_or(PendingWake::NONE, WakeHandle::take))
    }

    /// # Safety
    ///
    /// `node` is in this list.
    #[inline]
    unsafe fn remove(&mut self, node: NonNull<Node<N>>) -> Option<WakeHandle> {
        // SAFETY: the node is in this list, as is demanded here: by the invariant it is live. The
        // list is borrowed from its lock, so no other thread accesses either.
        unsafe {
            self.0.remove(node.cast());
            (*node.as_ptr()).is_listed = false;
            (*node.as_ptr()).wait.wake_handle_mut().take()
        }
    }
}

impl<N: Copy> Default for OpList<N> {
    fn default() -> Self {
        Self::new()
    }
}

luna_platform::debug_fields!(impl[N] OpList<N>, |list| first: list.0);

/// A waiting operation. Dropped while it waits, it is withdrawn: O(1), under the lock.
#[must_use = "it waits only when awaited"]
pub struct Op<K: Kind> {
    kind: K,
    place: Place<K::Note>,
}

/// Where the node of an operation lies.
///
/// # Invariants
///
/// If `may_be_listed`, the node is there and this is pinned. A listed node is in the list of its
/// operation's kind, and leaves it before it goes.
struct Place<N> {
    may_be_listed: bool,
    node: UnsafeCell<MaybeUninit<Node<N>>>,
    _pinned: PhantomPinned,
}

// SAFETY: the node is accessed under the list's lock, wherever the future is.
unsafe impl<N: Send> Send for Place<N> {}
// SAFETY: `&Place` is not used for the node, but by the operation that is pinned or dropped.
unsafe impl<N> Sync for Place<N> {}

impl<N: Copy> Place<N> {
    #[inline]
    fn node(&self) -> NonNull<Node<N>> {
        NonNull::from(&self.node).cast()
    }

    /// Under the lock of `queue`, for an operation that is pinned: its output, or it is listed.
    /// `unused` is to be dropped without the lock.
    #[inline]
    fn attempt<K: Kind<Note = N>>(
        &mut self,
        kind: &K,
        queue: &mut K::Queue,
        renewal: &mut Renewal<'_, '_>,
        unused: &mut Option<WakeHandle>,
    ) -> Option<K::Output> {
        let node = self.node();
        // SAFETY: a node that may be listed is there, and the lock is held that guards it.
        let is_listed = self.may_be_listed && unsafe { node.as_ref() }.is_listed;
        if core::mem::replace(&mut self.may_be_listed, is_listed)
            && !is_listed
            && let Some(output) = kind.settled()
        {
            return Some(output);
        }
        if let Some(output) = kind.attempt(queue) {
            return Some(output);
        }
        if is_listed {
            // SAFETY: the node is there, and the lock is held that guards it.
            renewal.store(unsafe { (*node.as_ptr()).wait.wake_handle_mut() });
            return None;
        }
        let handle = renewal.take()?;
        let note = match kind.begin(queue) {
            Ok(note) => note,
            Err(output) => {
                *unused = Some(handle);
                return Some(output);
            }
        };
        self.may_be_listed = true;
        let new = Node {
            wait: WaitNode::new(),
            is_listed: true,
            note,
        };
        // SAFETY: the node is in no list, so it is this operation's alone. It is pinned, and its
        // drop takes it off the list, of which the lock is held.
        unsafe {
            node.write(new);
            let list = &mut kind.list(queue).0;
            list.insert(node.cast(), current::priority(), handle);
        }
        None
    }
}

impl<K: Kind> Op<K> {
    /// One that has not begun to wait.
    #[inline]
    pub fn new(kind: K) -> Self {
        Op {
            kind,
            place: Place {
                may_be_listed: false,
                node: UnsafeCell::new(MaybeUninit::uninit()),
                _pinned: PhantomPinned,
            },
        }
    }

    /// What it waits for.
    #[inline]
    pub fn kind(&self) -> &K {
        &self.kind
    }

    /// What it waits for, to be changed.
    pub fn kind_mut(self: Pin<&mut Self>) -> &mut K {
        // SAFETY: the kind is not what is pinned.
        unsafe { &mut self.get_unchecked_mut().kind }
    }

    /// Whether it has begun to wait, and has not learned since that it does no more.
    #[inline]
    pub fn has_waited(&self) -> bool {
        self.place.may_be_listed
    }

    #[cold]
    fn withdraw(&mut self) {
        events::waits_no_more(|| None);
        let node = self.place.node();
        let mut queue = self.kind.lock();
        // SAFETY: the node is there, since it may be listed, and the lock is held that guards it.
        // One that is listed is in the list of its kind.
        let former = unsafe {
            if !node.as_ref().is_listed {
                return;
            }
            self.kind.list(&mut queue).remove(node)
        };
        self.kind.withdrawn(&mut queue);
        drop(queue);
        // The last step, since its drop is user code.
        drop(former);
    }
}

impl<K: Kind> Future for Op<K> {
    type Output = K::Output;

    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<K::Output> {
        // SAFETY: what is pinned is the node, which this code leaves where it is.
        let Op { kind, place } = unsafe { self.get_unchecked_mut() };
        // What is not needed is dropped last.
        let (mut renewal, mut unused) = (Renewal::of(cx), None);
        let output =
            renewal.put(|renewal| place.attempt(kind, &mut kind.lock(), renewal, &mut unused));
        match output {
            Some(output) => Poll::Ready(output),
            None => {
                events::waits_for_other();
                Poll::Pending
            }
        }
    }
}

impl<K: Kind> Drop for Op<K> {
    #[inline]
    fn drop(&mut self) {
        if self.place.may_be_listed {
            self.withdraw();
        }
    }
}

luna_platform::debug_fields!(impl[K: Kind] Op<K>, |op| waits: op.place.may_be_listed);
