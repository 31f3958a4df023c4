//! The link of the sending side.

use crate::session::{End, Partner, Session};
use crate::wait::{First, Seen, Waits};
use crate::{IpcError, Status};
use luna::channel::{ChannelEnd, Extended};
use luna::{Error, Process, Receiver};
use luna_platform::clock::Clock;
use std::fmt;
use std::future::Future;
use std::pin::pin;
use std::sync::atomic::Ordering::SeqCst;

/// Carries values from a local channel to the other program: made by [`sender`](crate::sender).
///
/// It is a process, to be spawned on the executor of its senders or on another one, or to be run by
/// hand once: `link.pre_run()?`, `link.run().await`. It ends
///
/// - without an error when the last local sender is gone and its values were taken, or when the
///   other program's receivers are gone: the local channel is then closed;
/// - with [`Error::Poisoned`] when the channel is poisoned on either side. Both sides then are;
/// - with [`IpcError::PartnerDied`] when the other program has ended without closing its side: the
///   local channel is poisoned, and a send under way gets its value back. This takes as long as the
///   kernel takes to end that process, and to schedule this thread.
///
/// Dropping the link closes the session: not for the real-time path.
///
/// Real-time path: yes, from joining on. A value costs one system call to wake the other program
/// if it sleeps; to wait for the acknowledgement costs three at most. Joining allocates and makes
/// six system calls.
#[must_use = "a link is a process: spawn it"]
pub struct SendLink<T> {
    session: Session<T>,
    receiver: Option<Receiver<T>>,
    status: Status,
    looks: u32,
}

impl<T: Send> SendLink<T> {
    pub(crate) fn new(session: Session<T>, receiver: Receiver<T>) -> Self {
        Self {
            session,
            receiver: Some(receiver.external()),
            status: Status::default(),
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

/// Refuses the value of a rendezvous that was not acknowledged, also if the link is dropped.
struct Offered<'a, T>(Option<Extended<'a, T>>);

impl<'a, T> Offered<'a, T> {
    fn acknowledge(&mut self) {
        // Its sender goes on.
        self.0 = None;
    }

    fn refuse(&mut self, end: ChannelEnd) {
        if let Some(value) = self.0.take() {
            value.refuse(end);
        }
    }
}

impl<T> Drop for Offered<'_, T> {
    fn drop(&mut self) {
        self.refuse(ChannelEnd::Closed);
    }
}

impl<T: Send> Process for SendLink<T> {
    /// # Errors
    ///
    /// [`IpcError::VirtualClock`].
    fn pre_run(&mut self) -> luna::Result<()> {
        refuse_virtual_clock(self.session.name())
    }

    fn run(&mut self) -> impl Future<Output = luna::Result<()>> {
        // Here, off the real-time path. If it fails, the first wait fails too, and reports it.
        let _ = luna::external::prepare_files();
        async {
            let Some(receiver) = self.receiver.take() else {
                let name = self.session.name().to_owned();
                return Err(Error::other(IpcError::RunTwice { name }));
            };
            let carried = carry(&self.session, &receiver, &self.status, self.looks).await;
            finish(carried, || receiver.poison())
        }
    }
}

/// Why a link ends.
pub(crate) enum Stop {
    /// The local channel or the partner's has ended so.
    Ended(ChannelEnd),
    Failed(IpcError),
}

impl From<IpcError> for Stop {
    fn from(error: IpcError) -> Self {
        Stop::Failed(error)
    }
}

/// What the process of a link ends with.
pub(crate) fn finish(stop: Stop, poison: impl FnOnce()) -> luna::Result<()> {
    match stop {
        Stop::Ended(ChannelEnd::Closed) => Ok(()),
        Stop::Ended(ChannelEnd::Poisoned) => {
            poison();
            Err(Error::Poisoned)
        }
        Stop::Failed(error) => {
            poison();
            Err(Error::other(error))
        }
    }
}

pub(crate) fn refuse_virtual_clock(name: &str) -> luna::Result<()> {
    match Clock::is_virtual_here() {
        true => Err(Error::other(IpcError::VirtualClock {
            name: name.to_owned(),
        })),
        false => Ok(()),
    }
}

/// Reports the end of this side's local channel to the partner.
pub(crate) fn end_session<T>(
    session: &Session<T>,
    partner: Option<&Partner>,
    end: ChannelEnd,
) -> Stop {
    session.end(match end {
        ChannelEnd::Closed => End::Closed,
        ChannelEnd::Poisoned => End::Poisoned,
    });
    if let Some(partner) = partner {
        session.ring(partner);
    }
    Stop::Ended(end)
}

pub(crate) fn died<T>(session: &Session<T>, partner: &Partner, status: &Status) -> Stop {
    Stop::Failed(IpcError::PartnerDied {
        name: session.name().to_owned(),
        role: partner.role(),
        pid: partner.pid,
        acknowledged: status.acknowledged(),
    })
}

impl From<End> for ChannelEnd {
    fn from(end: End) -> Self {
        match end {
            End::Closed => ChannelEnd::Closed,
            End::Poisoned => ChannelEnd::Poisoned,
        }
    }
}

async fn carry<T>(
    session: &Session<T>,
    receiver: &Receiver<T>,
    status: &Status,
    looks: u32,
) -> Stop {
    let joined = {
        let mut waits = Waits::new(session);
        let is_bound = |session: &Session<T>| session.is_bound().then_some(());
        match waits.first(pin!(receiver.ended()), is_bound).await {
            // What is in the buffer is still to be delivered.
            Ok(First::Own(ChannelEnd::Closed)) if receiver.buffered() > 0 => {
                waits.first(pin!(receiver.poisoned()), is_bound).await
            }
            joined => joined,
        }
    };
    match joined {
        Ok(First::Own(end)) => return end_session(session, None, end),
        Ok(First::Other(_)) => {}
        Err(error) => return error.into(),
    }
    match session.partner() {
        Ok(partner) => match carry_to(session, &partner, receiver, status, looks).await {
            Ok(stop) => stop,
            Err(error) => error.into(),
        },
        Err(error) => error.into(),
    }
}

async fn carry_to<T>(
    session: &Session<T>,
    partner: &Partner,
    receiver: &Receiver<T>,
    status: &Status,
    looks: u32,
) -> Result<Stop, IpcError> {
    let mut waits = Waits::new(session);
    waits.watch(partner, looks);
    let words = session.words();
    let mut number = partner.start;
    status.joined(partner.pid, number, number - words.taken().min(number));
    let mut poisoned = pin!(receiver.poisoned());
    loop {
        let next = pin!(receiver.recv_extended());
        let value = match waits.first(next, Session::partners_end).await? {
            First::Own(Ok(value)) => value,
            First::Own(Err(error)) => {
                let end = match error.is_closed() {
                    true => ChannelEnd::Closed,
                    false => ChannelEnd::Poisoned,
                };
                return Ok(end_session(session, Some(partner), end));
            }
            First::Other(Seen::Word(end)) => return Ok(Stop::Ended(end.into())),
            First::Other(Seen::Death) => return Ok(died(session, partner, status)),
        };
        // SAFETY: this is the sender of the bound session, and the value before was taken.
        let written = unsafe { session.memory().write(&value) };
        let mut offered = Offered(Some(value));
        if let Err(why) = written {
            offered.refuse(ChannelEnd::Poisoned);
            end_session(session, Some(partner), ChannelEnd::Poisoned);
            return Err(IpcError::Encode {
                name: session.name().to_owned(),
                capacity: session.memory().capacity(),
                why,
            });
        }
        number += 1;
        session.own().number.store(number, SeqCst);
        session.ring(partner);
        let answered = |session: &Session<T>| match session.words().taken() >= number {
            true => Some(None),
            false => session.partners_end().map(Some),
        };
        match waits.first(poisoned.as_mut(), answered).await? {
            First::Other(Seen::Word(None)) => {
                status.acknowledge(number);
                offered.acknowledge();
            }
            First::Other(Seen::Word(Some(end))) => {
                offered.refuse(end.into());
                return Ok(Stop::Ended(end.into()));
            }
            First::Other(Seen::Death) => {
                offered.refuse(ChannelEnd::Poisoned);
                return Ok(died(session, partner, status));
            }
            First::Own(end) => return Ok(end_session(session, Some(partner), end)),
        }
    }
}

impl<T> fmt::Debug for SendLink<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SendLink")
            .field("name", &self.session.name())
            .field("status", &self.status)
            .finish_non_exhaustive()
    }
}
