//! Waiting for the end of a process.

use super::end::Shown;
use super::{Exit, Process};
use crate::current::{ProcessId, User};
use crate::waiting::{Kind, Op, OpList};
use alloc::vec::Vec;
use core::future::Future;
use core::ops::DerefMut;
use core::pin::Pin;
use core::task::{Context, Poll, ready};
use pin_project_lite::pin_project;

pin_project! {
    /// Waits for the end of a process: see [`ProcessHandle::join`](crate::ProcessHandle::join).
    #[must_use = "a join does nothing unless awaited"]
    pub struct Join<'a> {
        #[pin]
        op: Op<End<'a>>,
    }
}

struct End<'a>(&'a Process);

impl<'a> Join<'a> {
    pub(super) fn new(process: &'a Process) -> Self {
        Self {
            op: Op::new(End(process)),
        }
    }
}

// SAFETY: a process has one lock, and one list of joins, which it guards.
unsafe impl Kind for End<'_> {
    type Queue = Shown;
    type Note = ();
    type Output = ();

    fn lock(&self) -> impl DerefMut<Target = Shown> {
        self.0.record.shown.lock()
    }

    fn list<'q>(&self, shown: &'q mut Shown) -> &'q mut OpList<()> {
        &mut shown.joining
    }

    fn attempt(&self, _: &mut Shown) -> Option<()> {
        self.0.has_ended().then_some(())
    }

    fn begin(&self, _: &mut Shown) -> Result<(), ()> {
        Ok(())
    }
}

impl Future for Join<'_> {
    type Output = Exit;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Exit> {
        let op = self.project().op;
        let process = op.kind().0;
        // One that has waited looks under the lock whether it is still listed.
        if op.has_waited() || !process.has_ended() {
            ready!(op.poll(cx));
        }
        process.exit().map_or(Poll::Pending, Poll::Ready)
    }
}

/// The processes that wait for the end of `process`.
pub(super) fn joiners(process: &Process) -> Vec<ProcessId> {
    // Room is made without the lock, for as many as were there when it was held.
    let mut joiners = Vec::new();
    loop {
        let room = joiners.capacity();
        let mut count = 0;
        {
            let shown = process.record.shown.lock();
            for (user, ()) in shown.joining.waiting() {
                count += 1;
                if let User::Process(id) = user
                    && count <= room
                {
                    joiners.push(id);
                }
            }
        }
        if count <= room {
            return joiners;
        }
        joiners = Vec::with_capacity(count);
    }
}

luna_platform::debug_fields!(Join<'_>, |join| process: join.op.kind().0.record.name);
