//! The named sub-processes of a system as a list, and how it is read while they come and go.
//!
//! The nodes lie in the futures ([`Named`](super::named::Named)), in the order of their first
//! polls; each holds the number of the node under which it runs. Only the reader follows those
//! numbers, once it has copied them, so a node refers to no other one but its neighbours.

use arrayvec::ArrayString;
use luna_core::current::ProcessId;
use luna_platform::lock::PiLock;
use std::cell::UnsafeCell;
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

/// One line of the tree, in the list of its system.
///
/// # Invariants
///
/// While it is listed it is pinned, `id`, `parent` and `process` are written under the list's lock
/// and by its future alone, the links under the lock by any thread, and `name` not at all.
pub(crate) struct Node {
    before: Option<NonNull<Node>>,
    after: Option<NonNull<Node>>,
    /// Rises along the list; 0 of a reader's mark.
    pub(crate) id: u64,
    /// The id of the node that it runs in; 0 if it runs in the process itself.
    pub(crate) parent: u64,
    pub(crate) process: Option<ProcessId>,
    pub(crate) name: Label,
    pub(crate) is_running: AtomicBool,
    pub(crate) level: AtomicU8,
}

impl Node {
    pub(crate) fn new(name: Label) -> Self {
        Self {
            before: None,
            after: None,
            id: 0,
            parent: 0,
            process: None,
            name,
            is_running: AtomicBool::new(false),
            level: AtomicU8::new(0),
        }
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
    pub(crate) last: Option<NonNull<Node>>,
    pub(crate) next_id: u64,
}

// SAFETY: the list owns no node; the lock that guards it guards the nodes' links too, so it may go
// where the lock goes.
unsafe impl Send for List {}

impl List {
    /// Puts `node` behind `before`, or first.
    ///
    /// # Safety
    ///
    /// `node` is in no list, stays where it is, and is removed before it dies; `before` is in this
    /// one.
    pub(crate) unsafe fn insert(&mut self, node: NonNull<Node>, before: Option<NonNull<Node>>) {
        // SAFETY: the caller promises that `node` is in no list, so its links are the caller's, and
        // that `before` is in this one; what is listed is live by the invariant, and this borrow
        // shows that the lock of its links is held. Fields alone are borrowed, since others look at
        // the rest.
        unsafe {
            let after = match before {
                Some(before) => (*before.as_ptr()).after.replace(node),
                None => self.first.replace(node),
            };
            (*node.as_ptr()).before = before;
            (*node.as_ptr()).after = after;
            match after {
                Some(after) => (*after.as_ptr()).before = Some(node),
                None => self.last = Some(node),
            }
        }
    }

    /// # Safety
    ///
    /// `node` is in this list.
    pub(crate) unsafe fn remove(&mut self, node: NonNull<Node>) {
        // SAFETY: the caller promises that `node` is in this list: by the invariant it and its
        // neighbours are live, and this borrow shows that the lock of their links is held.
        unsafe {
            let before = (*node.as_ptr()).before.take();
            let after = (*node.as_ptr()).after.take();
            match before {
                Some(before) => (*before.as_ptr()).after = after,
                None => self.first = after,
            }
            match after {
                Some(after) => (*after.as_ptr()).before = before,
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
    node: &'a UnsafeCell<Node>,
}

impl Mark<'_> {
    fn node(&self) -> NonNull<Node> {
        NonNull::from(self.node).cast()
    }
}

impl Drop for Mark<'_> {
    fn drop(&mut self) {
        // SAFETY: it was listed when the mark was made.
        unsafe { self.tree.list.lock().remove(self.node()) };
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
        let node = UnsafeCell::new(Node::new(Label::new()));
        let end = {
            let mut list = self.list.lock();
            // SAFETY: the node is in no list, and is removed by the mark, before it dies.
            unsafe { list.insert(NonNull::from(&node).cast(), None) };
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
            // SAFETY: the mark is listed, so what follows it is, and is live. Fields alone are
            // borrowed, since its future changes others.
            unsafe {
                let Some(next) = (*mark.node().as_ptr()).after else {
                    return true;
                };
                let (id, process) = ((*next.as_ptr()).id, (*next.as_ptr()).process);
                if id >= end {
                    return true;
                }
                list.remove(mark.node());
                list.insert(mark.node(), Some(next));
                // Another reader's mark has no process.
                found.extend(process.map(|process| SubProcess {
                    id,
                    parent: (*next.as_ptr()).parent,
                    process,
                    is_running: (*next.as_ptr()).is_running.load(Ordering::Relaxed),
                    level: (*next.as_ptr()).level.load(Ordering::Relaxed),
                    name: (*next.as_ptr()).name,
                }));
            }
        }
        false
    }
}
