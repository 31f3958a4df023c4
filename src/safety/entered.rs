//! Waiting for the safe state.

use super::emergency::Emergency;
use super::state::{Degree, Level};
use luna_core::waiting::{Kind, Op, OpList};
use luna_platform::lock::PiLock;
use pin_project_lite::pin_project;
use std::future::Future;
use std::ops::DerefMut;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

/// The tasks that wait for a system's safe state.
#[derive(Debug)]
pub(crate) struct Waiting(PiLock<List>);

#[derive(Debug)]
struct List {
    /// Each with the number of rounds that had been called when it was listed.
    waiters: OpList<u64>,
    /// How often the waiting tasks were called.
    round: u64,
}

impl Waiting {
    pub(super) fn new() -> Self {
        Self(PiLock::new(List {
            waiters: OpList::new(),
            round: 0,
        }))
    }

    /// Wakes all waiting tasks, the most urgent first, but none that begins to wait meanwhile:
    /// those see the new degree. They wait again when the safe state was left again, or when they
    /// have already reported this one. O(their number); a system call for each with a sleeping
    /// thread.
    pub(super) fn wake_all(&self) {
        let round = {
            let mut list = self.0.lock();
            list.round += 1;
            list.round
        };
        let take = || self.0.lock().waiters.take(|listed| listed < round);
        while let Some(ready) = take() {
            // A panic of one waker must not keep the others asleep.
            ready.wake_contained();
        }
    }
}

pin_project! {
    /// What waits for the safe state: made by `safe_state_entered` or `safe_state_edge` of its
    /// handle.
    #[must_use = "it waits only when awaited"]
    pub struct SafeStateEntered {
        #[pin]
        op: Op<Entry>,
    }
}

/// A level of the safe state, or an emergency's.
struct Entry {
    emergency: Arc<Emergency>,
    /// Whether it reports each safe state once.
    is_edge: bool,
    /// The level that it has reported.
    reported: Option<Level>,
}

impl SafeStateEntered {
    pub(super) fn new(emergency: Arc<Emergency>, is_edge: bool) -> Self {
        Self {
            op: Op::new(Entry {
                emergency,
                is_edge,
                reported: None,
            }),
        }
    }
}

// SAFETY: an emergency has one lock, which guards its one list.
unsafe impl Kind for Entry {
    type Queue = List;
    type Note = u64;
    type Output = Level;

    fn lock(&self) -> impl DerefMut<Target = List> {
        self.emergency.waiting.0.lock()
    }

    fn list<'q>(&self, list: &'q mut List) -> &'q mut OpList<u64> {
        &mut list.waiters
    }

    /// A thread that enters the safe state sets the degree before it takes the lock: one of the two
    /// sees the other.
    fn attempt(&self, _: &mut List) -> Option<Level> {
        let level = self.emergency.journal.level();
        let is_news = !self.is_edge || self.reported != Some(level);
        (level.degree() >= Degree::SafeState && is_news).then_some(level)
    }

    fn begin(&self, list: &mut List) -> Result<u64, Level> {
        Ok(list.round)
    }
}

impl Future for SafeStateEntered {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let mut op = self.project().op;
        let level = ready!(op.as_mut().poll(cx));
        op.kind_mut().reported = Some(level);
        Poll::Ready(())
    }
}

luna_platform::debug_fields!(SafeStateEntered);

#[cfg(test)]
mod tests;
