//! The process that carries values between a local channel and the other program.

use crate::session::{End, Partner, Session};
use crate::wait::{First, Waits};
use crate::{IpcError, Status};
use luna::channel::ChannelEnd;
use luna::external::readable;
use luna::realtime::off_path;
use luna::{Error, Process};
use luna_events::{self as events, code};
use luna_platform::clock::Clock;
use std::pin::pin;
use std::sync::Arc;

/// Carries values between a local channel and the other program.
///
/// It is a process, to be spawned on the executor of the processes that use its channel or on
/// another one, or to be run by hand once: `link.pre_run()?`, `link.run().await`. It ends
///
/// - without an error when the last local end is gone and its values were taken, or when the other
///   program's ends are gone: the local channel is then closed;
/// - with [`Error::Poisoned`] when the channel is poisoned on either side. Both sides then are;
/// - with [`IpcError::PartnerDied`] when the other program has ended without closing its side: the
///   local channel is poisoned, a send under way gets its value back, and a value that is offered
///   here and not yet taken is withdrawn. This takes as long as the kernel takes to end that
///   process, and to schedule this thread.
///
/// Dropping the link closes the session: not for the real-time path.
///
/// Real-time path: yes, from joining on. A value costs one system call to wake the other program
/// if it sleeps; to wait for it costs three at most. Joining allocates and makes six system calls,
/// and so does the end.
#[must_use = "a link is a process: spawn it"]
pub struct Link<N> {
    session: Arc<Session>,
    near: Option<N>,
    status: Status,
    looks: u32,
}

/// What a link does with its local channel.
pub(crate) trait Near: Send {
    /// Waits for a partner, or for the end of the local channel.
    async fn alone(&self, waits: &mut Waits<'_, '_>) -> Result<First<ChannelEnd, ()>, IpcError>;

    /// Carries values until there are no more.
    async fn carry(&self, bound: &mut Bound<'_, '_>) -> Result<Stop, IpcError>;

    fn poison(&self);
}

/// A session with a partner.
pub(crate) struct Bound<'w, 'f> {
    pub(crate) session: &'f Session,
    pub(crate) partner: &'f Partner,
    pub(crate) waits: Waits<'w, 'f>,
    pub(crate) status: &'f Status,
    /// The session, in events.
    key: u64,
}

impl Bound<'_, '_> {
    /// Records that this value was sent, or taken, if the thread is recorded.
    pub(crate) fn report(&self, number: u64, is_taken: bool) {
        if events::is_on() {
            let process = events::current_process() as u32;
            let arguments = || [number, code::link::argument(self.key, is_taken)];
            events::report(code::LINK, process, arguments);
        }
    }

    /// Reports the end of this side's local channel to the partner.
    pub(crate) fn end(&self, end: ChannelEnd) -> Stop {
        self.session.end(end.into());
        self.session.ring(self.partner);
        Stop::Ended(end)
    }

    /// The partner has written this number where the one after `before` was to follow.
    pub(crate) fn broken(&self, number: u64, before: u64) -> IpcError {
        self.end(ChannelEnd::Poisoned);
        off_path(|| IpcError::Broken {
            name: self.session.name().to_owned(),
            pid: self.partner.pid,
            number,
            expected: before,
        })
    }

    pub(crate) fn died(&self) -> Stop {
        off_path(|| {
            Stop::Failed(IpcError::PartnerDied {
                name: self.session.name().to_owned(),
                role: self.partner.role(),
                pid: self.partner.pid,
                acknowledged: self.status.acknowledged(),
            })
        })
    }
}

/// Why a link ends.
pub(crate) enum Stop {
    /// The local channel or the partner's has ended so.
    Ended(ChannelEnd),
    Failed(IpcError),
}

impl From<End> for ChannelEnd {
    fn from(end: End) -> Self {
        match end {
            End::Closed => ChannelEnd::Closed,
            End::Poisoned => ChannelEnd::Poisoned,
        }
    }
}

impl From<ChannelEnd> for End {
    fn from(end: ChannelEnd) -> Self {
        match end {
            ChannelEnd::Closed => End::Closed,
            ChannelEnd::Poisoned => End::Poisoned,
        }
    }
}

impl<N> Link<N> {
    pub(crate) fn new(session: impl Into<Arc<Session>>, near: N) -> Self {
        let session = session.into();
        let status = Status::default();
        status.opened(session.memory().is_locked());
        Self {
            session,
            near: Some(near),
            status,
            looks: 0,
        }
    }

    /// In how many turns of its executor the link looks for the other program before it waits; 0 if
    /// not stated. While it looks, the other program makes no system call to wake it: for partners
    /// that answer within microseconds, on executors that are busy anyway. On one without other
    /// ready processes it keeps the core busy for so many turns of some tens of nanoseconds; on a
    /// busy one it takes part in each round of its priority, and processes of lower priority wait
    /// meanwhile. Never unbounded: then it waits asleep.
    pub fn looks(mut self, turns: u32) -> Self {
        self.looks = turns;
        self
    }

    /// What it has done.
    pub fn status(&self) -> Status {
        self.status.clone()
    }
}

impl<N: Near> Process for Link<N> {
    /// # Errors
    ///
    /// [`IpcError::VirtualClock`].
    fn pre_run(&mut self) -> luna::Result<()> {
        match Clock::is_virtual_here() {
            true => Err(Error::other(IpcError::VirtualClock {
                name: self.session.name().to_owned(),
            })),
            false => Ok(()),
        }
    }

    async fn run(&mut self) -> luna::Result<()> {
        // If it fails, the first wait fails too, and reports it.
        let _ = off_path(luna::external::prepare_files);
        let Some(near) = self.near.take() else {
            let name = self.session.name().to_owned();
            return Err(Error::other(IpcError::RunTwice { name }));
        };
        let stop = run(&self.session, &near, &self.status, self.looks).await;
        let stop = stop.unwrap_or_else(Stop::Failed);
        if !matches!(stop, Stop::Ended(ChannelEnd::Closed)) {
            near.poison();
        }
        off_path(|| {
            drop(near);
            match stop {
                Stop::Ended(ChannelEnd::Closed) => Ok(()),
                Stop::Ended(ChannelEnd::Poisoned) => Err(Error::Poisoned),
                Stop::Failed(error) => Err(Error::other(error)),
            }
        })
    }
}

async fn run(
    session: &Session,
    near: &impl Near,
    status: &Status,
    looks: u32,
) -> Result<Stop, IpcError> {
    let joined = {
        let bell = pin!(readable(session.bell()));
        near.alone(&mut Waits::new(session, bell)).await?
    };
    if let First::Own(end) = joined {
        session.end(end.into());
        return Ok(Stop::Ended(end));
    }
    let partner = off_path(|| session.partner())?;
    let stop = {
        let bell = pin!(readable(session.bell()));
        let death = pin!(readable(&partner.process));
        let mut waits = Waits::new(session, bell);
        waits.watch(death, looks);
        let start = partner.start;
        let missing = start.saturating_sub(session.words().taken());
        status.joined(partner.pid, start, missing);
        let mut bound = Bound {
            session,
            partner: &partner,
            waits,
            status,
            key: session.key(),
        };
        near.carry(&mut bound).await
    };
    off_path(|| drop(partner));
    stop
}

luna_platform::debug_fields!(
    impl[N] Link<N>, |link|
    name: link.session.name(),
    status: link.status
);
