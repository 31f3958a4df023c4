//! Named sub-processes: futures that are shown, with a name, in the composition tree of the system
//! while they live.

use super::tree::{Node, Tree, label};
use luna_core::current::{self, Process, ProcessId};
use luna_events::{self as events, Kind, code};
use pin_project_lite::pin_project;
use std::cell::{Cell, RefCell};
use std::future::Future;
use std::pin::Pin;
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
        is_reported: false,
        node: Node::new(label(name)),
        future,
    }
}

pin_project! {
    /// A named sub-process: see [`named`].
    ///
    /// # Invariants
    ///
    /// `node` is in the list of `tree` exactly while there is a `tree`.
    #[must_use = "a sub-process does nothing unless awaited"]
    pub struct Named<F> {
        tree: Option<Arc<Tree>>,
        is_reported: bool,
        #[pin]
        node: Node,
        #[pin]
        future: F,
    }

    impl<F> PinnedDrop for Named<F> {
        fn drop(this: Pin<&mut Self>) {
            this.unlist(code::sub_ended::DROPPED);
        }
    }
}

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
        self.node.name.as_str()
    }

    /// Ensures that the node is listed under what it is being polled in. Returns its id, 0 where
    /// there is no system.
    fn list(mut self: Pin<&mut Self>, process: ProcessId) -> u64 {
        let parent = WITHIN.get();
        if self.tree.is_some() {
            if self.node.process() == Some(process) && self.node.parent() == parent {
                return self.node.id();
            }
            // It was moved to another process, or to another part of this one.
            self.as_mut().unlist(code::sub_ended::DROPPED);
        }
        let Some(tree) = TREE.with_borrow(Clone::clone) else {
            return 0;
        };
        let this = self.project();
        // SAFETY: without a tree the node is in no list; it is pinned, and unlisted before it dies.
        let id = unsafe { tree.list.lock().push(&this.node, process, parent) };
        *this.tree = Some(tree);
        *this.is_reported = events::is_on();
        if *this.is_reported {
            events::name_in_ring(Kind::SubProcess, id as u32, &this.node.name);
        }
        id
    }

    /// `how` is one of [`code::sub_ended`].
    fn unlist(self: Pin<&mut Self>, how: u64) {
        let this = self.project();
        if let Some(tree) = this.tree.take() {
            if std::mem::take(this.is_reported) {
                // On a thread of another system its number would denote another sub-process.
                let is_here = TREE.try_with(|here| {
                    let here = here.borrow();
                    here.as_ref().is_some_and(|here| Arc::ptr_eq(here, &tree))
                });
                if is_here.unwrap_or(false) {
                    events::report(code::SUB_DONE, this.node.id() as u32, || [how, 0]);
                }
            }
            // SAFETY: while there was a tree the node was in its list.
            unsafe { tree.list.lock().remove(&this.node) };
        }
    }
}

impl<F: Future> Named<F> {
    fn poll_within(self: Pin<&mut Self>, within: u64, cx: &mut Context<'_>) -> Poll<F::Output> {
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
        let this = self.project();
        let node = this.node.into_ref().get_ref();
        node.is_running.store(true, Ordering::Relaxed);
        node.level
            .store(current::priority().level, Ordering::Relaxed);
        let _ended = Ended {
            within: WITHIN.replace(within),
            is_running: &node.is_running,
        };
        this.future.poll(cx)
    }
}

impl<F: Future> Future for Named<F> {
    type Output = F::Output;

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<F::Output> {
        let process = current::process(|process| process.map(Process::id));
        let around = WITHIN.get();
        let id = process.map_or(0, |process| self.as_mut().list(process));
        let within = if id == 0 { around } else { id };
        let is_reported = self.is_reported;
        let mut poll = || self.as_mut().poll_within(within, cx);
        let polled = match process {
            Some(process) if is_reported => {
                events::sub_turn(id as u32, [process.get().into(), around], poll)
            }
            _ => poll(),
        };
        if polled.is_ready() {
            self.unlist(code::sub_ended::RETURNED);
        }
        polled
    }
}

luna_platform::debug_fields!(impl[F] Named<F>, |named| name: named.name());

#[cfg(test)]
mod tests;
