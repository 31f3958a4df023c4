//! Process data: what is in a PDO, and the processes that send it.

use super::client::SdoError;
use super::heartbeat::ended_is_well;
use super::nmt::frame;
use super::{Object, PdoValue, SdoClient};
use crate::Frame;
use luna::{Process, Receiver, Sender};
use std::time::Duration;

/// When a PDO is sent, or what was received takes effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Transmission {
    /// With every so many SYNC messages: 1 to 240.
    Synchronous(u8),
    /// When the node has something new (type 255).
    OnEvent,
}

impl Transmission {
    fn code(self) -> Result<u8, PdoError> {
        match self {
            Transmission::Synchronous(every @ 1..=240) => Ok(every),
            Transmission::Synchronous(every) => Err(PdoError::Transmission(every)),
            Transmission::OnEvent => Ok(255),
        }
    }
}

/// The direction of a PDO, as the node sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Direction {
    /// The node transmits it.
    Tpdo,
    /// The node receives it.
    Rpdo,
}

/// How a PDO of a node is to be: its number, identifier, transmission, and the objects in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PdoSetting {
    direction: Direction,
    number: u16,
    id: u16,
    /// Its transmission type.
    transmission: u8,
    /// Objects with their length in bytes.
    objects: Vec<(Object, u8)>,
}

/// A setting that cannot be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PdoError {
    /// The number of a PDO is 1 to 512.
    #[error("PDOs are counted from 1 to 512")]
    Number,
    /// The identifier is not one of those that are left for PDOs: other services have it, or it
    /// has more than 11 bits.
    #[error("{0:03X}h is no identifier of a PDO: those are 181h to 57Fh and 680h to 6DFh")]
    Identifier(u16),
    /// A PDO is sent with every 1 to 240 SYNC messages.
    #[error("a PDO cannot be sent with every {0} SYNC messages, but with every 1 to 240")]
    Transmission(u8),
    /// The objects have more than 8 bytes.
    #[error("the objects in a PDO have {0} bytes, but there is room for 8")]
    TooLong(usize),
}

impl From<PdoError> for luna::Error {
    fn from(error: PdoError) -> Self {
        luna::Error::other(error)
    }
}

/// The identifier, if a PDO can have it. Those of NMT, SYNC, EMCY, TIME, SDO and heartbeats, and
/// those that CiA 301 reserves, are for no PDO.
pub(super) fn checked(id: u16) -> Result<u16, PdoError> {
    match id {
        0x181..0x580 | 0x680..0x6E0 => Ok(id),
        _ => Err(PdoError::Identifier(id)),
    }
}

impl PdoSetting {
    /// A PDO, counted from 1, without objects yet.
    ///
    /// # Errors
    ///
    /// [`PdoError::Number`], [`PdoError::Identifier`], [`PdoError::Transmission`].
    pub fn new(
        direction: Direction,
        number: u16,
        id: u16,
        transmission: Transmission,
    ) -> Result<Self, PdoError> {
        if !(1..=512).contains(&number) {
            return Err(PdoError::Number);
        }
        Ok(Self {
            direction,
            number,
            id: checked(id)?,
            transmission: transmission.code()?,
            objects: Vec::new(),
        })
    }

    /// Adds an object of this type behind those that are there.
    ///
    /// # Errors
    ///
    /// [`PdoError::TooLong`].
    pub fn map<T: super::Value>(mut self, object: Object) -> Result<Self, PdoError> {
        let len = T::LEN
            + self
                .objects
                .iter()
                .map(|(_, len)| usize::from(*len))
                .sum::<usize>();
        if len > 8 {
            return Err(PdoError::TooLong(len));
        }
        self.objects.push((object, T::LEN as u8));
        Ok(self)
    }

    /// Sets it up in a node, which is to be pre-operational: switches the PDO off, writes
    /// transmission and mapping, and switches it on. A PDO that the node transmits is not to be
    /// asked for by remote frames.
    ///
    /// # Errors
    ///
    /// The first that the node refuses, or does not answer. The PDO is as it was if that is the
    /// first write, and off after the second to the last but one. If an answer is missing, the node
    /// may have taken that write: after the first or the last the PDO is on or off.
    pub async fn write(&self, sdo: &mut SdoClient) -> Result<(), SdoError> {
        let (communication, mapping) = match self.direction {
            Direction::Tpdo => (0x1800, 0x1A00),
            Direction::Rpdo => (0x1400, 0x1600),
        };
        let communication = communication + self.number - 1;
        let mapping = mapping + self.number - 1;
        // Bit 31 switches it off. Bit 30 of a TPDO forbids remote frames, which many devices do
        // not support; of an RPDO it is reserved.
        let on = match self.direction {
            Direction::Tpdo => 1 << 30 | u32::from(self.id),
            Direction::Rpdo => self.id.into(),
        };
        let off = 1 << 31 | on;
        sdo.write(Object::new(communication, 1), off).await?;
        sdo.write(Object::new(communication, 2), self.transmission)
            .await?;
        sdo.write(Object::new(mapping, 0), 0_u8).await?;
        for (number, (object, len)) in (1..).zip(&self.objects) {
            let bits = u32::from(*len) * 8;
            let entry = u32::from(object.index) << 16 | u32::from(object.sub) << 8 | bits;
            sdo.write(Object::new(mapping, number), entry).await?;
        }
        let count = self.objects.len() as u8;
        sdo.write(Object::new(mapping, 0), count).await?;
        sdo.write(Object::new(communication, 1), on).await
    }
}

/// Sends the values of a channel as PDOs, one each, to be spawned: see
/// [`Network::rpdo`](super::Network::rpdo).
///
/// It ends without an error when the senders of values or the controller are gone. Real-time path:
/// yes; no allocation.
#[derive(Debug)]
#[must_use = "a producer is a process: spawn it"]
pub struct PdoProducer<T> {
    pub(super) id: u16,
    pub(super) values: Receiver<T>,
    pub(super) frames: Sender<Frame>,
}

impl<T: PdoValue> PdoProducer<T> {
    async fn go_on(&mut self) -> luna::Result<()> {
        loop {
            let value = self.values.recv().await?;
            self.frames.send(encode(self.id, &value)).await?;
        }
    }
}

impl<T: PdoValue> Process for PdoProducer<T> {
    async fn run(&mut self) -> luna::Result<()> {
        ended_is_well(self.go_on().await)
    }
}

/// The frame of a value.
fn encode<T: PdoValue>(id: u16, value: &T) -> Frame {
    const { assert!(T::LEN <= 8, "a PDO has at most 8 bytes") };
    let mut bytes = [0; 8];
    value.encode(&mut bytes[..T::LEN]);
    frame(id, &bytes[..T::LEN])
}

/// The value of a frame. CiA 301: of a PDO that is longer than its mapping the first bytes count,
/// one that is shorter is not processed.
pub(super) fn decode<T: PdoValue>(frame: &Frame) -> Option<T> {
    const { assert!(T::LEN <= 8, "a PDO has at most 8 bytes") };
    match frame.is_remote() {
        true => None,
        false => T::decode(frame.data().get(..T::LEN)?),
    }
}

/// Sends SYNC messages with a period, to be spawned: see [`Network::sync`](super::Network::sync).
///
/// It sends from its start on; `false` from its channel makes it pause, `true` go on. It ends
/// without an error when the senders of that or the controller are gone. Its loop is in the report
/// as `SYNC`. Real-time path: yes; no allocation.
#[derive(Debug)]
#[must_use = "a producer is a process: spawn it"]
pub struct SyncProducer {
    pub(super) period: Duration,
    pub(super) switch: Receiver<bool>,
    pub(super) frames: Sender<Frame>,
}

/// A SYNC message.
pub const SYNC: u16 = 0x80;

impl SyncProducer {
    async fn go_on(&mut self) -> luna::Result<()> {
        let mut tick = luna::periodic("SYNC", self.period)?;
        let mut is_on = true;
        loop {
            tick.next().await;
            loop {
                match self.switch.try_recv() {
                    Ok(newer) => is_on = newer,
                    Err(error) if error.is_empty() => break,
                    Err(error) => return Err(error.into()),
                }
            }
            if is_on {
                self.frames.send(frame(SYNC, &[])).await?;
            }
        }
    }
}

impl Process for SyncProducer {
    async fn run(&mut self) -> luna::Result<()> {
        ended_is_well(self.go_on().await)
    }
}
