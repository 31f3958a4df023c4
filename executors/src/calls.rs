//! The calls on the pool that the processes of a thread have begun: counted, since their ends wake processes.

use crate::presence::Presence;
use crate::process::Living;
use std::cell::RefCell;
use std::sync::Arc;

/// Where the calls of one thread are counted, and who is told when the last has ended.
#[derive(Clone)]
pub(crate) struct Desk {
    presence: Arc<Presence>,
    living: Option<Arc<Living>>,
}

thread_local! {
    /// The desk of this thread, while it runs processes.
    static HERE: RefCell<Option<Desk>> = const { RefCell::new(None) };
}

/// Counts the calls of this thread in `presence` until the guard is dropped.
pub(crate) fn enter(presence: Arc<Presence>, living: Option<Arc<Living>>) -> DeskGuard {
    HERE.set(Some(Desk { presence, living }));
    DeskGuard(())
}

#[must_use = "calls are counted until the guard is dropped"]
pub(crate) struct DeskGuard(());

impl Drop for DeskGuard {
    fn drop(&mut self) {
        HERE.take();
    }
}

/// A call that is under way, from its beginning until after the wake that it leads to.
pub(crate) struct UnderWay(Option<Desk>);

impl UnderWay {
    /// A call begins on this thread. One that no home has begun is counted nowhere.
    pub(crate) fn begin() -> Self {
        let desk = HERE.with_borrow(Clone::clone);
        if let Some(desk) = &desk {
            desk.presence.begin_call();
        }
        Self(desk)
    }
}

impl Drop for UnderWay {
    fn drop(&mut self) {
        if let Some(desk) = &self.0
            && desk.presence.end_call()
            && let Some(living) = &desk.living
        {
            living.announce();
        }
    }
}
