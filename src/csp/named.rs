//! Named sub-processes: futures that are shown, with a name, in the composition tree of the system
//! while they live.

use super::tree::{Node, Tree, label};
use luna_core::current::{self, Process, ProcessId};
use luna_core::events::{self, Kind, code};
use std::cell::{Cell, RefCell, UnsafeCell};
use std::future::Future;
use std::marker::PhantomPinned;
use std::pin::Pin;
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};

/// Gives a part of a process a name: it stands as a sub-process in the
/// [`Composition`](crate::inspect::Composition) of the system from its first poll until it has
/// ended or is dropped, under the named sub-process that it runs in, or else under its process.
///
/// The first 63 bytes of the name are kept, cut between characters. Within `luna::run`, where there
/// is no system, and under other runtimes it is the future and nothing else.
///
/// In a recording with events its turns are recorded, with its name. The parts of a process that
/// have no name are recorded as the process.
///
/// Real-time path: yes; nothing is allocated. The first poll and the end take a priority-inheriting
/// lock for a few steps, O(1); the polls in between cost some stores. Cancel-safe if the future is.
///
/// ```
/// use luna::prelude::*;
///
/// let mut system = System::new("named");
/// let observer = system.observer();
/// let main = system.executor("main").build()?;
/// main.process("drive").spawn(async move {
///     par!(
///         luna::named("left", async {
///             let shown = observer.composition().threads[0].processes[0].children[0].name.clone();
///             assert_eq!(shown, "left");
///             Ok(())
///         }),
///         luna::named("right", async { Ok(()) }),
///     )
///     .await?;
///     Ok(())
/// })?;
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
pub fn named<F: Future>(name: &str, future: F) -> Named<F> {
    Named {
        tree: None,
        untold: None,
        is_reported: false,
        node: NodeCell(UnsafeCell::new(Node::new(label(name)))),
        future,
        _pinned: PhantomPinned,
    }
}

/// A named sub-process: see [`named`].
///
/// # Invariants
///
/// `node` is in the list of `tree` exactly while there is a `tree`; it is then pinned. Its links,
/// `id`, `parent` and `process` are written under the list's lock alone, and but for the links by
/// this future alone. `untold` is `None`, or the process of the node, which is then listed.
#[must_use = "a sub-process does nothing unless awaited"]
pub struct Named<F> {
    tree: Option<Arc<Tree>>,
    /// The process in which it is listed while its turns are not recorded: that of almost every
    /// poll.
    untold: Option<ProcessId>,
    is_reported: bool,
    node: NodeCell,
    future: F,
    _pinned: PhantomPinned,
}

/// Where a node lies.
struct NodeCell(UnsafeCell<Node>);

// SAFETY: a node's links are guarded by the list's lock, wherever the future is; all else is its
// future's, or does not change while listed.
unsafe impl Send for NodeCell {}
// SAFETY: `&Named` gives access to the name alone, which does not change.
unsafe impl Sync for NodeCell {}

thread_local! {
    /// The tree of the system to which this thread belongs.
    static TREE: RefCell<Option<Arc<Tree>>> = const { RefCell::new(None) };
    /// The sub-process that is being polled, 0 if none is.
    static WITHIN: Cell<u64> = const { Cell::new(0) };
}

impl Tree {
    pub(crate) fn enter_thread(self: &Arc<Self>) {
        TREE.set(Some(self.clone()));
    }
}

impl<F> Named<F> {
    /// The name, as it is kept.
    pub fn name(&self) -> &str {
        // SAFETY: the name does not change, and this borrows it alone.
        unsafe { &(*self.node.0.get()).name }.as_str()
    }

    /// Ensures that the node is listed under what it is being polled in. Returns its id, 0 where
    /// there is no system.
    ///
    /// # Safety
    ///
    /// The future is pinned.
    unsafe fn list(&mut self, process: ProcessId) -> u64 {
        let node = NonNull::from(&self.node.0).cast::<Node>();
        let parent = WITHIN.get();
        if self.tree.is_some() {
            // SAFETY: this future alone writes these fields, so it may read them without the lock.
            let (of, under, id) = unsafe {
                (
                    (*node.as_ptr()).process,
                    (*node.as_ptr()).parent,
                    (*node.as_ptr()).id,
                )
            };
            if of == Some(process) && under == parent {
                return id;
            }
            // It was moved to another process, or to another part of this one.
            self.unlist(code::sub_ended::DROPPED);
        }
        let Some(tree) = TREE.with_borrow(Clone::clone) else {
            return 0;
        };
        let id = {
            let mut list = tree.list.lock();
            let (id, last) = (list.next_id, list.last);
            list.next_id += 1;
            // SAFETY: the node is in no list, so it is this future's alone; it is pinned, and
            // unlisted before it dies.
            unsafe {
                (*node.as_ptr()).id = id;
                (*node.as_ptr()).parent = parent;
                (*node.as_ptr()).process = Some(process);
                list.insert(node, last);
            }
            id
        };
        self.tree = Some(tree);
        self.is_reported = events::is_on();
        if self.is_reported {
            events::name_in_ring(Kind::SubProcess, id as u32, self.name());
        } else {
            self.untold = Some(process);
        }
        id
    }

    /// `how` is one of [`code::sub_ended`].
    fn unlist(&mut self, how: u64) {
        self.untold = None;
        if let Some(tree) = self.tree.take() {
            if std::mem::take(&mut self.is_reported) {
                // On a thread of another system its number would denote another sub-process.
                let is_here = TREE.try_with(|here| {
                    let here = here.borrow();
                    here.as_ref().is_some_and(|here| Arc::ptr_eq(here, &tree))
                });
                if is_here.unwrap_or(false) {
                    // SAFETY: this future alone writes the field.
                    let id = unsafe { (*self.node.0.get()).id };
                    events::report(code::SUB_DONE, id as u32, || [how, 0]);
                }
            }
            let node = NonNull::from(&self.node.0).cast::<Node>();
            // SAFETY: while there was a tree the node was in its list.
            unsafe { tree.list.lock().remove(node) };
        }
    }
}

impl<F: Future> Named<F> {
    /// # Safety
    ///
    /// The future is pinned.
    unsafe fn poll_within(&mut self, within: u64, cx: &mut Context<'_>) -> Poll<F::Output> {
        /// Notes that it does not run any more, also when it has panicked.
        struct Ended<'a> {
            within: u64,
            is_running: &'a AtomicBool,
        }
        impl Drop for Ended<'_> {
            fn drop(&mut self) {
                WITHIN.set(self.within);
                self.is_running.store(false, Ordering::Relaxed);
            }
        }
        // SAFETY: both are atomic, and may be borrowed while others look at them.
        let (is_running, level) = unsafe {
            let node = self.node.0.get();
            (&(*node).is_running, &(*node).level)
        };
        is_running.store(true, Ordering::Relaxed);
        level.store(current::priority().level, Ordering::Relaxed);
        let _ended = Ended {
            within: WITHIN.replace(within),
            is_running,
        };
        // SAFETY: the future is pinned with the whole.
        unsafe { Pin::new_unchecked(&mut self.future) }.poll(cx)
    }

    /// A poll that is the first one in this place, or is recorded, or is outside of any system.
    ///
    /// # Safety
    ///
    /// The future is pinned.
    #[cold]
    #[inline(never)]
    unsafe fn poll_otherwise(
        &mut self,
        process: ProcessId,
        cx: &mut Context<'_>,
    ) -> Poll<F::Output> {
        // SAFETY: the caller promises that the future is pinned, as `list` requires.
        let id = unsafe { self.list(process) };
        let around = WITHIN.get();
        let within = if id == 0 { around } else { id };
        let is_reported = self.is_reported;
        // SAFETY: the caller promises that the future is pinned, as `poll_within` requires.
        let mut poll = || unsafe { self.poll_within(within, cx) };
        if is_reported {
            events::sub_turn(id as u32, [process.get().into(), around], poll)
        } else {
            poll()
        }
    }
}

impl<F: Future> Future for Named<F> {
    type Output = F::Output;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<F::Output> {
        // SAFETY: nothing is moved out.
        let this = unsafe { self.get_unchecked_mut() };
        let process = current::process(|process| process.map(Process::id));
        let around = WITHIN.get();
        // SAFETY: this future alone writes these fields, so it may read them without the lock.
        let (parent, id) = unsafe { ((*this.node.0.get()).parent, (*this.node.0.get()).id) };
        let within = match process {
            None => Some(around),
            listed if this.untold == listed && parent == around => Some(id),
            _ => None,
        };
        let polled = match (within, process) {
            // SAFETY: the future is pinned, as this value is.
            (None, Some(process)) => unsafe { this.poll_otherwise(process, cx) },
            // SAFETY: the future is pinned, as this value is.
            (within, _) => unsafe { this.poll_within(within.unwrap_or(around), cx) },
        };
        if polled.is_ready() {
            this.unlist(code::sub_ended::RETURNED);
        }
        polled
    }
}

impl<F> Drop for Named<F> {
    fn drop(&mut self) {
        self.unlist(code::sub_ended::DROPPED);
    }
}

debug_parts!(Named<F> as named: name = named.name());

#[cfg(test)]
mod tests;
