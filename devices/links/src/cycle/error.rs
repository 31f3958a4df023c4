//! What can go wrong.

use super::data::TypeIdentity;
use super::sample::Silence;
use luna::external::FileError;
use std::io;
use std::net::SocketAddr;

/// Why a link cannot be opened or used, or gives nothing.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CycleError {
    /// The local address is that of all interfaces.
    #[error(
        "udp link to {peer}: {local} is no address of one network: state the address of the interface that leads to the partner"
    )]
    AnyAddress {
        /// The local address.
        local: SocketAddr,
        /// The partner's.
        peer: SocketAddr,
    },
    /// The partner's address or port is 0.
    #[error("udp link from {local}: {peer} is no partner's address: state its address and port")]
    NoPeer {
        /// The local address.
        local: SocketAddr,
        /// The partner's.
        peer: SocketAddr,
    },
    /// The system refuses the socket, or a datagram for a reason that does not pass.
    #[error("udp link to {peer}: cannot {what}: {source}")]
    Socket {
        /// The partner's address.
        peer: SocketAddr,
        /// What was to be done.
        what: &'static str,
        /// The system's error.
        source: io::Error,
    },
    /// The partner is silent.
    #[error(
        "udp link to {peer}: {} value for more than {:?}: see whether its program runs and the wire is connected{}",
        if .silence.has_heard { "no" } else { "not one" }, .silence.limit, OtherType(.other_type)
    )]
    Stale {
        /// The partner's address.
        peer: SocketAddr,
        /// Since when, and how long that may be.
        silence: Silence,
        /// The type that is to be received, and the one that the partner states, if it has stated
        /// another one.
        other_type: Option<(TypeIdentity, TypeIdentity)>,
    },
    /// The link is used on a virtual clock, which does not wait for other computers.
    #[error(
        "udp link to {peer}: another computer does not follow a virtual clock: connect a simulated wire by `luna_links::cycle::Protocol`"
    )]
    VirtualClock {
        /// The partner's address.
        peer: SocketAddr,
    },
    /// The executor cannot wait for the socket.
    #[error("udp link to {peer}: {source}")]
    Wait {
        /// The partner's address.
        peer: SocketAddr,
        /// Why.
        source: FileError,
    },
}

impl CycleError {
    /// Whether the partner is silent: the link may be used again, and hears it when it speaks.
    pub fn is_stale(&self) -> bool {
        matches!(self, CycleError::Stale { .. })
    }
}

impl From<CycleError> for luna::Error {
    fn from(error: CycleError) -> Self {
        luna::Error::other(error)
    }
}

struct OtherType<'a>(&'a Option<(TypeIdentity, TypeIdentity)>);

impl std::fmt::Display for OtherType<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            None => Ok(()),
            Some((here, there)) => write!(
                f,
                "; it sends another type ({there}) than is received here ({here}): build both from one definition"
            ),
        }
    }
}
