//! What a link asks of the system: addresses, clocks, and a datagram handed over.

use super::error::CycleError;
use super::protocol::Moment;
use super::status::Status;
use luna::time::{Stamp, StampClock, StampSource};
use luna_machine::socket;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};

/// Linux: the queue of the network's device is full.
const ENOBUFS: i32 = 105;

/// What became of a value that was to be sent. None of it is sent later: the next value is newer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Sent {
    /// The system has it.
    Handed,
    /// The socket's buffer, or the queue of the network's device, is full.
    Full,
    /// No program listens there, or the network does not lead there.
    Refused,
}

/// The present moment.
pub(super) fn moment(source: StampSource) -> Moment {
    let instant = luna::now();
    let stamp = match source.clock() {
        StampClock::Monotonic => Stamp::from_nanos(instant.as_nanos()),
        StampClock::Tai => source.now(),
    };
    Moment { stamp, instant }
}

/// Once more after a refusal: the system reports one of an earlier datagram in place of sending.
pub(super) fn hand_over(socket: &UdpSocket, bytes: &[u8], status: &Status) -> io::Result<Sent> {
    let mut was_refused = false;
    loop {
        match socket::send_now(socket, bytes) {
            Ok(_) => {
                status.count(|counters| &counters.sent);
                return Ok(Sent::Handed);
            }
            Err(error) if is_refusal(&error) => {
                status.count(|counters| &counters.refused);
                if std::mem::replace(&mut was_refused, true) {
                    return Ok(Sent::Refused);
                }
            }
            Err(error)
                if error.kind() == ErrorKind::WouldBlock
                    || error.raw_os_error() == Some(ENOBUFS) =>
            {
                status.count(|counters| &counters.full);
                return Ok(Sent::Full);
            }
            Err(error) => return Err(error),
        }
    }
}

/// What passes when the other program starts, or the wire is connected.
pub(super) fn is_refusal(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::ConnectionRefused
            | ErrorKind::HostUnreachable
            | ErrorKind::NetworkUnreachable
            | ErrorKind::NetworkDown
    )
}

pub(super) fn check_addresses(local: SocketAddr, peer: SocketAddr) -> Result<(), CycleError> {
    if local.ip().is_unspecified() {
        return Err(CycleError::AnyAddress { local, peer });
    }
    if peer.ip().is_unspecified() || peer.port() == 0 {
        return Err(CycleError::NoPeer { local, peer });
    }
    Ok(())
}

/// A number that no other opening has: the standard library's seed for hash maps is random.
pub(super) fn new_session() -> u64 {
    RandomState::new().build_hasher().finish().max(1)
}
