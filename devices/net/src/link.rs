//! The process that carries values between a local channel and the link's thread.

use crate::carrier::Shared;
use crate::side::{Event, Stop};
use crate::{NetError, Status};
use luna::channel::ChannelEnd;
use luna::realtime::off_path;
use luna::{Error, Process, Receiver};
use luna_platform::clock::Clock;
use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::sync::Arc;
use std::task::Poll;

/// Carries values between a local channel and the other computer.
///
/// It is a process, to be spawned on the executor of the processes that use its channel or on
/// another one, or to be run by hand once: `link.pre_run()?`, `link.run().await`. It ends
///
/// - without an error when the last local end is gone and its values were taken, or when the other
///   program's ends are gone: the local channel is then closed;
/// - with [`Error::Poisoned`] when the channel is poisoned on either side. Both sides then are;
/// - with [`NetError::PartnerLost`] when the other program has ended without closing its side, or
///   cannot be reached: the local channel is poisoned, a send under way gets its value back, and a
///   value that is offered here and not yet taken is withdrawn. This takes as long as zenoh takes to
///   notice the end of the connection, and at most [`lost_after`](crate::Config::lost_after) and
///   a quarter of it more, with what the system takes to schedule the link's thread.
///
/// Real-time path: yes, from joining on; no lock is shared with zenoh, and no allocation is made
/// but those of the value's `Serialize`. A value, or a batch of a stream's values, costs a
/// hand-over to the link's own thread and one back: a system call each if that thread sleeps. The
/// end allocates, and waits until the other side knows it, for about [`lost_after`](crate::Config::lost_after) at most; the local channel is
/// closed or poisoned before that.
#[must_use = "a link is a process: spawn it"]
pub struct Link<N> {
    line: Line,
    near: Option<N>,
}

/// What a link does with its local channel.
pub(crate) trait Near: Send {
    /// Carries values until there are no more.
    async fn carry(&self, line: &Line) -> Stop;

    fn poison(&self);
}

/// The process' side of what it shares with the link's thread. The session is ended when it is
/// dropped.
pub(crate) struct Line {
    pub(crate) name: String,
    pub(crate) shared: Arc<Shared>,
    pub(crate) events: Receiver<Event>,
    pub(crate) status: Status,
    is_ended: bool,
}

impl Line {
    pub(crate) fn new(
        name: String,
        shared: Arc<Shared>,
        events: Receiver<Event>,
        status: Status,
    ) -> Self {
        Self {
            name,
            shared,
            events,
            status,
            is_ended: false,
        }
    }

    /// Waits until the other program has joined; how many values may be under way.
    pub(crate) async fn joined(&self) -> Result<u64, Stop> {
        match self.events.recv().await {
            Ok(Event::Joined { window }) => Ok(window),
            Ok(Event::Stop(stop)) => Err(stop),
            Ok(Event::Over) | Err(_) => Err(self.thread_ended()),
        }
    }

    /// Waits until the other side ends the session.
    pub(crate) async fn stopped(&self) -> Stop {
        loop {
            match self.events.recv().await {
                Ok(Event::Joined { .. }) => {}
                Ok(Event::Stop(stop)) => return stop,
                Ok(Event::Over) | Err(_) => return self.thread_ended(),
            }
        }
    }

    pub(crate) fn thread_ended(&self) -> Stop {
        let name = self.name.clone();
        Stop::Failed(NetError::ThreadEnded { name })
    }

    fn end(&mut self, end: ChannelEnd) {
        if !std::mem::replace(&mut self.is_ended, true) {
            self.shared.end(end);
        }
    }

    /// Waits until the link's thread has ended.
    async fn over(&self) {
        while let Ok(event) = self.events.recv().await {
            if matches!(event, Event::Over) {
                return;
            }
        }
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.end(ChannelEnd::Closed);
    }
}

/// The first of two events.
pub(crate) enum First<A, B> {
    Own(A),
    Other(B),
}

/// Waits for the first of two events. If both have happened it is `own`.
pub(crate) async fn first<A, B>(
    mut own: Pin<&mut impl Future<Output = A>>,
    mut other: Pin<&mut impl Future<Output = B>>,
) -> First<A, B> {
    poll_fn(|cx| {
        if let Poll::Ready(done) = own.as_mut().poll(cx) {
            return Poll::Ready(First::Own(done));
        }
        other.as_mut().poll(cx).map(First::Other)
    })
    .await
}

pub(crate) fn end_of(is_closed: bool) -> ChannelEnd {
    match is_closed {
        true => ChannelEnd::Closed,
        false => ChannelEnd::Poisoned,
    }
}

impl<N> Link<N> {
    pub(crate) fn new(line: Line, near: N) -> Self {
        let near = Some(near);
        Self { line, near }
    }

    /// What it has done.
    pub fn status(&self) -> Status {
        self.line.status.clone()
    }
}

impl<N: Near> Process for Link<N> {
    /// # Errors
    ///
    /// [`NetError::VirtualClock`].
    fn pre_run(&mut self) -> luna::Result<()> {
        match Clock::is_virtual_here() {
            true => Err(Error::other(NetError::VirtualClock {
                name: self.line.name.clone(),
            })),
            false => Ok(()),
        }
    }

    async fn run(&mut self) -> luna::Result<()> {
        let Some(near) = self.near.take() else {
            let name = self.line.name.clone();
            return Err(Error::other(NetError::RunTwice { name }));
        };
        let stop = near.carry(&self.line).await;
        let end = match &stop {
            Stop::Ended(end) => *end,
            Stop::Failed(_) => ChannelEnd::Poisoned,
        };
        // What waits locally does not wait for the other side.
        if end == ChannelEnd::Poisoned {
            near.poison();
        }
        off_path(|| drop(near));
        self.line.end(end);
        self.line.over().await;
        off_path(|| match stop {
            Stop::Ended(ChannelEnd::Closed) => Ok(()),
            Stop::Ended(ChannelEnd::Poisoned) => Err(Error::Poisoned),
            Stop::Failed(error) => Err(Error::other(error)),
        })
    }
}

luna_platform::debug_fields!(
    impl[N] Link<N>, |link|
    name: link.line.name,
    status: link.line.status
);
