//! Waiting for the end of a channel, without offering to communicate.

use crate::in_place::InPlace;
use crate::replay::{self, Logged, Stage};
use crate::wait_point::{Ending, WaitPoint, WaitQueues};
use core::future::Future;
use core::ops::DerefMut;
use core::pin::Pin;
use core::task::{Context, Poll};
use luna_core::current::{self, PendingWake};
use luna_core::replay_log::{Event, Turn, What};
use luna_core::waiting::{Kind, Op, OpList};

/// How a channel has ended: what [`Ended`] gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ChannelEnd {
    /// The other ends are gone.
    Closed,
    /// The channel, or the branch that waits, was poisoned.
    Poisoned,
}

/// Takes out the most urgent watcher of the present ending, and returns its wake. O(watchers that
/// wait on).
pub(crate) fn take_watcher(lists: &mut WaitQueues) -> Option<PendingWake> {
    let ending = lists.ending;
    lists.watching.take(|watcher| watcher.end(ending).is_some())
}

/// What a process waits for that waits for the end.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Watcher {
    of_poison_alone: bool,
}

impl Watcher {
    /// The end that it waits for, if that is what `ending` says.
    fn end(self, ending: Ending) -> Option<ChannelEnd> {
        match ending {
            Ending::Poisoned => Some(ChannelEnd::Poisoned),
            Ending::Closed if !self.of_poison_alone => Some(ChannelEnd::Closed),
            _ => None,
        }
    }
}

struct End<'a> {
    wait_point: &'a WaitPoint,
    watcher: Watcher,
}

// SAFETY: a wait point has one lock, and one list of watchers, which it guards.
unsafe impl Kind for End<'_> {
    type Queue = WaitQueues;
    type Note = Watcher;
    type Output = ChannelEnd;

    fn lock(&self) -> impl DerefMut<Target = WaitQueues> {
        self.wait_point.lock_lists()
    }

    fn list<'q>(&self, lists: &'q mut WaitQueues) -> &'q mut OpList<Watcher> {
        &mut lists.watching
    }

    fn attempt(&self, lists: &mut WaitQueues) -> Option<ChannelEnd> {
        self.watcher.end(lists.ending)
    }

    fn begin(&self, _: &mut WaitQueues) -> Result<Watcher, ChannelEnd> {
        Ok(self.watcher)
    }
}

/// Waits for a channel's end: made by [`Sender::ended`](crate::Sender::ended),
/// [`Receiver::ended`](crate::Receiver::ended) and
/// [`Receiver::poisoned`](crate::Receiver::poisoned).
#[must_use = "it waits only when awaited"]
pub struct Ended<'a> {
    op: Op<End<'a>>,
    /// The result, while its process is held by its replay log.
    given: Option<ChannelEnd>,
    /// Its process' replay log has admitted it.
    has_entered: bool,
    /// It has let others run.
    has_given_way: bool,
}

impl<'a> Ended<'a> {
    pub(crate) fn new(wait_point: &'a WaitPoint, of_poison_alone: bool) -> Self {
        Self {
            op: Op::new(End {
                wait_point,
                watcher: Watcher { of_poison_alone },
            }),
            given: None,
            has_entered: false,
            has_given_way: false,
        }
    }
}

// SAFETY: what is pinned is the operation, which every method leaves where it is.
unsafe impl InPlace for Ended<'_> {}

impl Future for Ended<'_> {
    type Output = ChannelEnd;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<ChannelEnd> {
        replay::poll(self.in_place(), cx)
    }
}

impl Logged for Ended<'_> {
    type Output = ChannelEnd;

    const KEEPS: bool = true;

    fn stage(&self) -> Stage {
        match self.given {
            Some(_) => Stage::GaveWay,
            None => Stage::New,
        }
    }

    fn come(&mut self, turn: Turn, _: &mut Context<'_>) -> Poll<()> {
        self.has_entered = true;
        match turn {
            Turn::Record => Poll::Ready(()),
            // It did not end while the recorded process waited.
            Turn::Look => Poll::Pending,
            Turn::Given(event) => {
                self.given = Some(match event.number {
                    0 => ChannelEnd::Closed,
                    _ => ChannelEnd::Poisoned,
                });
                Poll::Ready(())
            }
        }
    }

    fn poll_unlogged(&mut self, cx: &mut Context<'_>) -> Poll<ChannelEnd> {
        if let Some(end) = self.given {
            return Poll::Ready(end);
        }
        if current::branch_failed() {
            current::stay_in_branch();
            return self.found(ChannelEnd::Poisoned, cx);
        }
        let has_waited = self.op.has_waited();
        // SAFETY: it is pinned with this future, whose methods do not move it.
        match unsafe { Pin::new_unchecked(&mut self.op) }.poll(cx) {
            Poll::Ready(end) if !has_waited => self.found(end, cx),
            polled => polled,
        }
    }

    unsafe fn success(&self, end: Option<&ChannelEnd>, _: u64) -> Event {
        let is_poisoned = end == Some(&ChannelEnd::Poisoned);
        Event::new(What::Chosen, u64::from(is_poisoned), replay::own_stamp())
    }

    fn keep(&mut self, end: ChannelEnd) {
        self.given = Some(end);
    }
}

impl Ended<'_> {
    /// The end that was found without waiting, after others have run if it is their turn. Once: in
    /// a process with a branch that spends all operations of each turn it would otherwise never
    /// come.
    #[cold]
    fn found(&mut self, end: ChannelEnd, cx: &Context<'_>) -> Poll<ChannelEnd> {
        if !self.has_given_way && crate::fails_later(cx) {
            self.has_given_way = true;
            return Poll::Pending;
        }
        Poll::Ready(end)
    }
}

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        if self.given.is_none() {
            replay::abandon(!self.has_entered);
        }
    }
}

luna_platform::debug_fields!(Ended<'_>);
