//! The link of the receiving side.

use crate::send_link::{Stop, died, end_session, finish, refuse_virtual_clock};
use crate::session::{Partner, Session};
use crate::wait::{First, Seen, Waits};
use crate::{IpcError, Status};
use luna::channel::ChannelEnd;
use luna::{Error, Process, Sender};
use std::fmt;
use std::future::Future;
use std::pin::pin;
use std::sync::atomic::Ordering::SeqCst;

/// Carries values from the other program to a local channel: made by
/// [`receiver`](crate::receiver).
///
/// It is a process, to be spawned on the executor of its receivers or on another one, or to be run
/// by hand once: `link.pre_run()?`, `link.run().await`. It ends as a [`SendLink`](crate::SendLink)
/// does, with the sides exchanged. If the sender's program ends while its value is offered here and
/// not yet taken, the value is withdrawn.
///
/// Dropping the link closes the session: not for the real-time path.
///
/// Real-time path: yes, from joining on. A value costs one system call to wake the other program
/// if it sleeps; to wait for the next value costs three at most. Joining allocates and makes six
/// system calls.
#[must_use = "a link is a process: spawn it"]
pub struct ReceiveLink<T> {
    session: Session<T>,
    sender: Option<Sender<T>>,
    status: Status,
    looks: u32,
}

impl<T: Send> ReceiveLink<T> {
    pub(crate) fn new(session: Session<T>, sender: Sender<T>) -> Self {
        Self {
            session,
            sender: Some(sender.external()),
            status: Status::default(),
            looks: 0,
        }
    }

    /// In how many turns the link looks for the other program before it waits: as
    /// [`SendLink::looks`](crate::SendLink::looks).
    pub fn looks(mut self, turns: u32) -> Self {
        self.looks = turns;
        self
    }

    /// What it has done.
    pub fn status(&self) -> Status {
        self.status.clone()
    }
}

impl<T: Send> Process for ReceiveLink<T> {
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
            let Some(sender) = self.sender.take() else {
                let name = self.session.name().to_owned();
                return Err(Error::other(IpcError::RunTwice { name }));
            };
            let stop = carry(&self.session, &sender, &self.status, self.looks).await;
            finish(stop, || sender.poison())
        }
    }
}

async fn carry<T>(session: &Session<T>, sender: &Sender<T>, status: &Status, looks: u32) -> Stop {
    let joined = {
        let mut waits = Waits::new(session);
        let is_bound = |session: &Session<T>| session.is_bound().then_some(());
        waits.first(pin!(sender.ended()), is_bound).await
    };
    match joined {
        Ok(First::Own(end)) => return end_session(session, None, end),
        Ok(First::Other(_)) => {}
        Err(error) => return error.into(),
    }
    match session.partner() {
        Ok(partner) => match carry_from(session, &partner, sender, status, looks).await {
            Ok(stop) => stop,
            Err(error) => error.into(),
        },
        Err(error) => error.into(),
    }
}

/// What the words of a sender show.
enum Next {
    Value(u64),
    End(ChannelEnd),
}

async fn carry_from<T>(
    session: &Session<T>,
    partner: &Partner,
    sender: &Sender<T>,
    status: &Status,
    looks: u32,
) -> Result<Stop, IpcError> {
    let mut waits = Waits::new(session);
    waits.watch(partner, looks);
    let words = session.words();
    let mut number = partner.start;
    status.joined(partner.pid, number, number - words.taken().min(number));
    let mut ended = pin!(sender.ended());
    loop {
        let next = |session: &Session<T>| match session.words().published() {
            published if published != number => Some(Next::Value(published)),
            _ => session.partners_end().map(|end| Next::End(end.into())),
        };
        let published = match waits.first(ended.as_mut(), next).await? {
            First::Own(end) => return Ok(end_session(session, Some(partner), end)),
            First::Other(Seen::Word(Next::Value(published))) => published,
            First::Other(Seen::Word(Next::End(end))) => return Ok(Stop::Ended(end)),
            First::Other(Seen::Death) => return Ok(died(session, partner, status)),
        };
        if published != number + 1 {
            return Err(IpcError::Broken {
                name: session.name().to_owned(),
                pid: partner.pid,
                number: published,
                expected: number,
            });
        }
        // SAFETY: this is the receiver of the bound session, in which the number was published, and
        // `taken` is stored below.
        let value = match unsafe { session.memory().read() } {
            Ok(value) => value,
            Err(why) => {
                end_session(session, Some(partner), ChannelEnd::Poisoned);
                return Err(IpcError::Decode {
                    name: session.name().to_owned(),
                    pid: partner.pid,
                    why,
                });
            }
        };
        let send = pin!(sender.send(value));
        match waits.first(send, Session::partners_end).await? {
            First::Own(Ok(())) => {
                number = published;
                session.own().number.store(number, SeqCst);
                session.ring(partner);
                status.acknowledge(number);
            }
            First::Own(Err(error)) => {
                let end = match error.is_closed() {
                    true => ChannelEnd::Closed,
                    false => ChannelEnd::Poisoned,
                };
                return Ok(end_session(session, Some(partner), end));
            }
            First::Other(Seen::Word(end)) => return Ok(Stop::Ended(end.into())),
            First::Other(Seen::Death) => return Ok(died(session, partner, status)),
        }
    }
}

impl<T> fmt::Debug for ReceiveLink<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ReceiveLink")
            .field("name", &self.session.name())
            .field("status", &self.status)
            .finish_non_exhaustive()
    }
}
