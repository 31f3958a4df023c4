//! The process that talks to a server.

use crate::exchange::Exchange;
use crate::point::{Source, Target, Value};
use crate::points::{Points, ReadPoint, WritePoint};
use crate::{Counts, Event, ModbusServer, SetUpError};
use luna::devices::Device;
use luna::external::LinkError;
use luna::{Error, Process, Receiver, Sender};
use luna_links::tcp::{Connector, Reconnect};
use luna_platform::clock::Clock;
use std::time::Duration;

/// Creates a client of a server, which in each `period` writes what waits and reads all points.
///
/// Points are added with [`read`](Client::read) and [`write`](Client::write). `events` gets what
/// goes wrong. Give it a buffer ([`luna::buffered`]), and a process that takes the reports. While
/// `events` is full the client waits over its connection: it neither reads nor writes, and does not
/// find that the server has gone. Connecting, and the loss of the device, do not wait for it. With
/// [`Buffer::overwrite_oldest`](luna::Buffer::overwrite_oldest) the client never waits, and the
/// oldest reports are lost.
///
/// # Errors
///
/// [`SetUpError::Zero`]: the period.
pub fn client(
    server: &Device<ModbusServer>,
    period: Duration,
    events: Sender<Event>,
) -> Result<Client, SetUpError> {
    if period.is_zero() {
        return Err(SetUpError::Zero { what: "period" });
    }
    Ok(Client {
        device: Some(server.clone()),
        period,
        unit: 1,
        answers: AnswerUnit::Asked,
        timeout: Duration::from_secs(1),
        reconnect: Reconnect::default(),
        points: Points::default(),
        events: Some(events.external()),
        counts: Counts::default(),
    })
}

/// Which unit the answers of a server name. The protocol has it be the one that was asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum AnswerUnit {
    /// The one that was asked.
    #[default]
    Asked,
    /// This one, whichever was asked: a gateway that answers as itself, or a device that takes 255
    /// and answers as 0 or 1.
    Is(u8),
    /// Any. The transaction's number alone says that it is the answer.
    Any,
}

/// A client, to be spawned: see [`client`].
///
/// It ends without an error when the other ends of all its points are gone, and all values to write
/// are written or reported. A poisoned channel ends it with that error. The device is
/// [lost](Device::lost) when the attempts of [`reconnect`](Self::reconnect) are used up, for the
/// reason why the last one failed, or why the last connection ended. The values that are buffered then are counted as [failures](Counts::write_failures), and reported if
/// `events` has room; those that are sent later are lost with their channels.
///
/// Off the real-time path: it allocates, and connecting takes a buddy thread. Spawn it on an
/// executor without real-time policy. It blocks no executor.
///
/// Cancel-safe: a request that is under way may or may not have its effect.
#[must_use = "a client is a process: spawn it"]
pub struct Client {
    device: Option<Device<ModbusServer>>,
    period: Duration,
    unit: u8,
    answers: AnswerUnit,
    timeout: Duration,
    reconnect: Reconnect,
    points: Points,
    events: Option<Sender<Event>>,
    counts: Counts,
}

impl Client {
    /// The unit behind the address, for gateways; 1 if not stated. Servers without units ignore it.
    /// For a server that is itself the device the protocol recommends 255, and 0 is used too.
    pub fn unit(mut self, unit: u8) -> Self {
        self.unit = unit;
        self
    }

    /// Which unit the answers name; [`AnswerUnit::Asked`] if not stated. An answer of another one
    /// closes the connection with [`Garbage::Unit`](crate::Garbage::Unit).
    pub fn answer_unit(mut self, answers: AnswerUnit) -> Self {
        self.answers = answers;
        self
    }

    /// How long an answer may take; 1 s if not stated. Then the connection is closed.
    ///
    /// # Errors
    ///
    /// [`SetUpError::Zero`].
    pub fn timeout(mut self, timeout: Duration) -> Result<Self, SetUpError> {
        if timeout.is_zero() {
            return Err(SetUpError::Zero { what: "timeout" });
        }
        self.timeout = timeout;
        Ok(self)
    }

    /// When it connects again; [`Reconnect::default`] if not stated. A connection is useful when
    /// the server has answered over it, be it by an exception.
    pub fn reconnect(mut self, policy: Reconnect) -> Self {
        self.reconnect = policy;
        self
    }

    /// Reads a point in each cycle, and sends its value if the channel has room; without room it is
    /// [counted](Counts::dropped). The client never waits for a reader: with
    /// [`Buffer::overwrite_oldest(1)`](luna::Buffer::overwrite_oldest) there is always room, and
    /// the reader has the newest value.
    ///
    /// While nothing can be read, nothing is sent: a reader that depends on new values receives
    /// with a timeout. Points that follow each other without a gap are read by one request, so they
    /// are of one moment, as far as the server keeps them together; and an exception is for all.
    ///
    /// # Errors
    ///
    /// [`SetUpError::PastTheEnd`].
    pub fn read<T: Value>(
        mut self,
        source: impl Into<Source<T>>,
        sender: Sender<T>,
    ) -> Result<Self, SetUpError> {
        let source = source.into();
        within_table(&source)?;
        let sender = sender.external();
        self.points
            .readings
            .push(Box::new(ReadPoint { source, sender }));
        Ok(self)
    }

    /// Writes the values of a channel to a point. In a cycle it takes those that wait at its
    /// begin, at most 16, in their order; more wait for the next cycles.
    ///
    /// Each value that is taken is confirmed by the server ([counted](Counts::written)), or
    /// reported by [`Event::WriteFailed`], unless the client is cancelled, a channel is poisoned,
    /// or the device is lost while `events` is full. It is never written twice. While there is no
    /// connection, or the server has closed it, no value is taken. A sender never waits with
    /// [`Buffer::overwrite_oldest(1)`](luna::Buffer::overwrite_oldest), which keeps the newest
    /// value alone.
    ///
    /// # Errors
    ///
    /// [`SetUpError::PastTheEnd`].
    pub fn write<T: Value>(
        mut self,
        target: Target<T>,
        receiver: Receiver<T>,
    ) -> Result<Self, SetUpError> {
        let source = target.0;
        within_table(&source)?;
        let receiver = receiver.external();
        self.points.writings.push(Box::new(WritePoint {
            source,
            receiver,
            is_over: false,
        }));
        Ok(self)
    }

    /// What it counts.
    pub fn counts(&self) -> Counts {
        self.counts.clone()
    }
}

fn within_table<T: Value>(source: &Source<T>) -> Result<(), SetUpError> {
    let place = source.place;
    match place.address.checked_add(place.width - 1) {
        Some(_) => Ok(()),
        None => Err(SetUpError::PastTheEnd {
            table: place.table,
            address: place.address,
        }),
    }
}

impl Process for Client {
    /// # Errors
    ///
    /// The system runs on a virtual clock, which a server does not follow.
    fn pre_run(&mut self) -> luna::Result<()> {
        if Clock::is_virtual_here() {
            return Err(Error::other(
                "a Modbus server takes real time, which a virtual clock does not wait for: simulate what is behind the client instead",
            ));
        }
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        let (Some(device), Some(events)) = (self.device.clone(), self.events.take()) else {
            return Err(LinkError::NotPrepared.into());
        };
        let mut points = std::mem::take(&mut self.points);
        points.arrange();
        let connector = Connector::new(device.address(), self.reconnect);
        let counts = self.counts.clone();
        let units = (self.unit, self.answers);
        let mut exchange = Exchange::new(connector, units, self.timeout, events, counts);
        exchange.go_on(&mut points, self.period, &device).await
    }

    /// Lets go of the device and the channels.
    fn post_run(&mut self) {
        self.points = Points::default();
        self.events = None;
        self.device = None;
    }
}

luna_platform::debug_fields!(
    Client, |client|
    device: client.device.as_ref().map(Device::name),
    period: client.period,
    unit: client.unit,
    timeout: client.timeout,
    counts: client.counts
);
