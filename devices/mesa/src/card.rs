//! A card, opened.

use crate::Link;
use hostmot2::{Client, ClientError, Description};
use luna::devices::{Device, DeviceError, DeviceManager, Sharing};
use std::io;
use std::net::{SocketAddr, ToSocketAddrs};
use std::time::Duration;

/// An opened card with its description. Two links of one card detect each other, and end; [`open`]
/// opens each card only once in a program.
#[derive(Debug)]
pub struct Card {
    address: SocketAddr,
    pub(crate) client: Client,
    pub(crate) description: Description,
    pub(crate) device: Option<Device<CardDevice>>,
}

/// A card as the device manager knows it: see [`open`].
#[derive(Debug)]
pub struct CardDevice {
    address: SocketAddr,
}

impl CardDevice {
    /// Where it is.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

/// Why a card cannot be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// Its address is invalid.
    #[error("the card's address is invalid: {}", reason(.error))]
    Address {
        /// The system's error, if there is one.
        #[source]
        error: Option<io::Error>,
    },
    /// It does not answer, or not as a HostMot2 does.
    #[error("{0}")]
    Client(#[source] ClientError),
    /// It is in use in this program.
    #[error("{0}")]
    Device(#[source] DeviceError),
}

/// As [`Card::open`], by the device manager: a card is open once, as `mesa:192.168.1.121:27181`,
/// until its link has ended and the outputs are off.
///
/// In an emergency the link's [process](Link::process) disables the outputs by itself, as the
/// device's own emergency function. A [`Fault`](crate::Fault) is the loss of the device: an
/// emergency, unless [`Device::on_loss`] of [`Card::device`] sets another reaction.
///
/// # Errors
///
/// [`OpenError`].
///
/// ```
/// use luna::System;
/// use luna_mesa::OpenError;
/// use luna_mesa_sim::{Server, Settings};
///
/// let server = Server::start(Settings::default()).unwrap();
/// let system = System::new("axis");
/// let card = luna_mesa::open(&system.devices(), server.address()).map_err(luna::Error::other)?;
/// let again = luna_mesa::open(&system.devices(), server.address());
/// assert!(matches!(again, Err(OpenError::Device(_))));
/// # drop(card);
/// # Ok::<(), luna::Error>(())
/// ```
pub fn open(devices: &DeviceManager, address: impl ToSocketAddrs) -> Result<Card, OpenError> {
    let address = resolve(address)?;
    let name = format!("mesa:{address}");
    let mut opened = None;
    let device = devices.open(&name, KIND, Sharing::Exclusive, || {
        let card = opened.insert(Card::open(address));
        match card {
            Ok(_) => Ok(CardDevice { address }),
            Err(_) => Err(DeviceError::Missing {
                device: name.clone(),
                kind: KIND,
            }),
        }
    });
    match (device, opened) {
        // Why it cannot be opened is known better.
        (_, Some(Err(error))) => Err(error),
        (Ok(device), Some(Ok(card))) => Ok(Card {
            device: Some(device),
            ..card
        }),
        (Err(error), _) => Err(OpenError::Device(error)),
        (Ok(device), None) => unreachable!("{device:?} is open, and was not opened"),
    }
}

const KIND: &str = "Mesa card";

fn resolve(address: impl ToSocketAddrs) -> Result<SocketAddr, OpenError> {
    let no_address = |error| OpenError::Address { error };
    let mut addresses = address
        .to_socket_addrs()
        .map_err(|error| no_address(Some(error)))?;
    addresses.next().ok_or_else(|| no_address(None))
}

fn reason(error: &Option<io::Error>) -> String {
    match error {
        Some(error) => error.to_string(),
        None => "no host of this name".to_owned(),
    }
}

impl Card {
    /// Reads the description of the card at `address` (`"192.168.1.121:27181"`), for half a second
    /// at most if it is silent. For set-up: blocks and allocates. Changes nothing on the card. The
    /// device manager is not involved: see [`open`] for that, and for a card that is neutral in an
    /// emergency by itself.
    ///
    /// # Errors
    ///
    /// [`OpenError`].
    pub fn open(address: impl ToSocketAddrs) -> Result<Self, OpenError> {
        let address = resolve(address)?;
        let mut client = Client::connect(address).map_err(OpenError::Client)?;
        let description = client.describe().map_err(OpenError::Client)?;
        Ok(Self {
            address,
            client,
            description,
            device: None,
        })
    }

    /// Where it is.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Its handle, if it was opened by [`open`]. A clone of it keeps the card open.
    pub fn device(&self) -> Option<&Device<CardDevice>> {
        self.device.as_ref()
    }

    /// What it is.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Creates a link called `name`, with a loop of that name that exchanges packets each `period`.
    /// Nothing is connected yet.
    pub fn link(self, name: &str, period: Duration) -> Link {
        Link::new(self, name, period)
    }
}
