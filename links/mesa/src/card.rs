//! A card, opened.

use crate::Link;
use hostmot2::{Client, ClientError, Description};
use std::fmt;
use std::io;
use std::net::{SocketAddr, ToSocketAddrs};
use std::time::Duration;

/// A card that has said what it is. Open each one once: two links of one card see that they are two, and end.
#[derive(Debug)]
pub struct Card {
    address: SocketAddr,
    pub(crate) client: Client,
    pub(crate) description: Description,
}

/// Why a card cannot be opened.
#[derive(Debug)]
#[non_exhaustive]
pub enum OpenError {
    /// Its address is none.
    Address {
        /// What the system said, if it did.
        error: Option<io::Error>,
    },
    /// It does not answer, or not as a HostMot2 does.
    Client(ClientError),
}

impl fmt::Display for OpenError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            OpenError::Address { error: Some(error) } => {
                write!(f, "the card's address is none: {error}")
            }
            OpenError::Address { error: None } => {
                f.write_str("the card's address is none: no host of this name")
            }
            OpenError::Client(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for OpenError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            OpenError::Address { error } => error.as_ref().map(|error| error as _),
            OpenError::Client(error) => Some(error),
        }
    }
}

impl Card {
    /// Asks the card at `address` (`"192.168.1.121:27181"`) what it is, for half a second at most if it is silent. For set-up: blocks and allocates. Changes nothing on the card.
    ///
    /// # Errors
    ///
    /// [`OpenError`].
    pub fn open(address: impl ToSocketAddrs) -> Result<Self, OpenError> {
        let no_address = |error| OpenError::Address { error };
        let mut addresses = address
            .to_socket_addrs()
            .map_err(|error| no_address(Some(error)))?;
        let address = addresses.next().ok_or_else(|| no_address(None))?;
        let mut client = Client::connect(address).map_err(OpenError::Client)?;
        let description = client.describe().map_err(OpenError::Client)?;
        Ok(Self {
            address,
            client,
            description,
        })
    }

    /// Where it is.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What it is.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// A link to it, called `name`, so is its loop, which exchanges packets each `period`. Nothing is connected yet.
    pub fn link(self, name: &str, period: Duration) -> Link {
        Link::new(self, name, period)
    }
}
