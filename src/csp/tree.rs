//! The named sub-processes of a system as a list, and how it is read while they come and go.
//!
//! The nodes lie in the futures ([`Named`](super::named::Named)), in the order of their first
//! polls; each holds the number of the node under which it runs. Only the reader follows those
//! numbers, once it has copied them, so a node refers to no other one but its neighbours.

use arrayvec::ArrayString;
use luna_core::current::ProcessId;
use luna_platform::lock::PiLock;
use std::cell::Cell;
use std::marker::PhantomPinned;
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicU64, Ordering};

/// One line of the tree, in the list of its system.
///
/// # Invariants
///
/// While it is listed it is pinned, and its links are accessed under the list's lock alone. `id`,
/// `parent` and `process` are written under that lock, by its future.
#[derive(Default)]
pub(crate) struct Node {
    before: Cell<Option<NonNull<Node>>>,
    after: Cell<Option<NonNull<Node>>>,
    /// Rises along the list; 0 of a reader's mark.
    id: AtomicU64,
    /// The id of the node that it runs in; 0 if it runs in the process itself.
    parent: AtomicU64,
    /// The number of its process; 0 of a reader's mark.
    process: AtomicU32,
    pub(crate) name: Label,
    pub(crate) is_running: AtomicBool,
    pub(crate) level: AtomicU8,
    _pinned: PhantomPinned,
}

// SAFETY: the links are guarded by the list's lock, wherever the node is; the rest may be sent.
unsafe impl Send for Node {}
// SAFETY: by the invariants the links are accessed under the list's lock alone; the rest is atomic,
// or does not change.
unsafe impl Sync for Node {}

impl Node {
    pub(crate) fn new(name: Label) -> Self {
        Self {
            name,
            ..Self::default()
        }
    }

    pub(crate) fn id(&self) -> u64 {
        self.id.load(Ordering::Relaxed)
    }

    pub(crate) fn parent(&self) -> u64 {
        self.parent.load(Ordering::Relaxed)
    }

    pub(crate) fn process(&self) -> Option<ProcessId> {
        ProcessId::from_number(self.process.load(Ordering::Relaxed))
    }
}

/// The name of a sub-process, or as much of it as fits.
pub(crate) type Label = ArrayString<63>;

pub(crate) fn label(name: &str) -> Label {
    let most = Label::new().capacity();
    Label::from(&name[..name.floor_char_boundary(most)]).unwrap_or_default()
}

/// The named sub-processes of one system.
pub(crate) struct Tree {
    pub(crate) list: PiLock<List>,
}

/// # Invariants
///
/// `first` and `last` are the ends of a doubly linked chain of live, pinned nodes, in rising order
/// of ids but for marks.
pub(crate) struct List {
    first: Option<NonNull<Node>>,
    last: Option<NonNull<Node>>,
    next_id: u64,
}

// SAFETY: the list owns no node; the lock that guards it guards the nodes' links too, so it may go
// where the lock goes.
unsafe impl Send for List {}

impl List {
    /// Puts the node of a sub-process last: it runs in `process`, and there in `parent`. Returns
    /// its id.
    ///
    /// # Safety
    ///
    /// `node` is in no list, stays where it is, and is removed before it dies.
    pub(crate) unsafe fn push(&mut self, node: &Node, process: ProcessId, parent: u64) -> u64 {
        let id = self.next_id;
        self.next_id += 1;
        node.id.store(id, Ordering::Relaxed);
        node.parent.store(parent, Ordering::Relaxed);
        node.process.store(process.get(), Ordering::Relaxed);
        // SAFETY: the node is as is demanded here, and the last one is in this list.
        unsafe { self.insert(node, self.last) };
        id
    }

    /// Puts `node` behind `before`, or first.
    ///
    /// # Safety
    ///
    /// `node` is in no list, stays where it is, and is removed before it dies; `before` is in this
    /// one.
    unsafe fn insert(&mut self, node: &Node, before: Option<NonNull<Node>>) {
        let link = Some(NonNull::from(node));
        // SAFETY: the caller promises that `node` is in no list, so its links are the caller's, and
        // that `before` is in this one; what is listed is live by the invariant, and this borrow
        // shows that the lock of its links is held.
        unsafe {
            let after = match before {
                Some(before) => before.as_ref().after.replace(link),
                None => std::mem::replace(&mut self.first, link),
            };
            node.before.set(before);
            node.after.set(after);
            match after {
                Some(after) => after.as_ref().before.set(link),
                None => self.last = link,
            }
        }
    }

    /// # Safety
    ///
    /// `node` is in this list.
    pub(crate) unsafe fn remove(&mut self, node: &Node) {
        let (before, after) = (node.before.take(), node.after.take());
        // SAFETY: the caller promises that `node` is in this list: by the invariant its neighbours
        // are live, and this borrow shows that the lock of their links is held.
        unsafe {
            match before {
                Some(before) => before.as_ref().after.set(after),
                None => self.first = after,
            }
            match after {
                Some(after) => after.as_ref().before.set(before),
                None => self.last = before,
            }
        }
    }
}

/// What the reader copies of a node.
#[derive(Debug)]
pub(crate) struct SubProcess {
    pub(crate) id: u64,
    pub(crate) parent: u64,
    pub(crate) process: ProcessId,
    pub(crate) is_running: bool,
    pub(crate) level: u8,
    pub(crate) name: Label,
}

/// For how many nodes the reader holds the lock at a time.
const AT_ONCE: usize = 16;

/// A reader's place in the list.
struct Mark<'a> {
    tree: &'a Tree,
    /// Listed for as long as the mark lives.
    node: &'a Node,
}

impl Drop for Mark<'_> {
    fn drop(&mut self) {
        // SAFETY: it was listed when the mark was made.
        unsafe { self.tree.list.lock().remove(self.node) };
    }
}

impl Tree {
    pub(crate) fn new() -> Arc<Self> {
        Arc::new(Self {
            list: PiLock::new(List {
                first: None,
                last: None,
                next_id: 1,
            }),
        })
    }

    /// The sub-processes that live, each of which was there at some moment of this call; parents
    /// before their children, unless they were moved. Those that begin meanwhile are left out, so
    /// it ends.
    ///
    /// Not for the real-time path: it allocates, though never under the lock, which it holds for a
    /// few nodes at a time.
    pub(crate) fn read(&self) -> Vec<SubProcess> {
        let node = Node::new(Label::new());
        let end = {
            let mut list = self.list.lock();
            // SAFETY: the node is in no list, and is removed by the mark, before it dies.
            unsafe { list.insert(&node, None) };
            list.next_id
        };
        let mark = Mark {
            tree: self,
            node: &node,
        };
        let mut found = Vec::new();
        loop {
            found.reserve(AT_ONCE);
            if self.read_on(&mark, end, &mut found) {
                return found;
            }
        }
    }

    /// Copies some of the nodes behind the mark, for which there is room, and moves the mark behind
    /// them; returns whether the list, or `end`, is reached.
    fn read_on(&self, mark: &Mark<'_>, end: u64, found: &mut Vec<SubProcess>) -> bool {
        let mut list = self.list.lock();
        for _ in 0..AT_ONCE {
            let Some(behind) = mark.node.after.get() else {
                return true;
            };
            // SAFETY: the mark is listed, so what follows it is, and is live while the lock is held.
            let next = unsafe { behind.as_ref() };
            let id = next.id();
            if id >= end {
                return true;
            }
            // SAFETY: the mark is listed, and so is what followed it.
            unsafe {
                list.remove(mark.node);
                list.insert(mark.node, Some(behind));
            }
            // Another reader's mark has no process.
            found.extend(next.process().map(|process| SubProcess {
                id,
                parent: next.parent(),
                process,
                is_running: next.is_running.load(Ordering::Relaxed),
                level: next.level.load(Ordering::Relaxed),
                name: next.name,
            }));
        }
        false
    }
}
