//! UDP: packets as the values of channels.
//!
//! One packet is one record, of at most the framing's size
//! ([`Framing::packets`](luna::external::Framing::packets)). A packet that is empty, too long, or
//! does not decode is broken. A packet that is refused because no program listens is
//! [counted](crate::Counts::refused), and no loss of the device: UDP guarantees nothing. Packets
//! wait in the kernel's buffer while the channel is not read, and are dropped there when it is
//! full. Let a channel of set-points overwrite its oldest value, and let the receiver time out. If
//! others than the peer can send, let broken packets be [dropped](crate::OnBad::Drop): otherwise
//! any of them can end the link with one.
//!
//! ```
//! use luna::external::Framing;
//! use luna::prelude::*;
//! use luna_links::{reader, udp, writer};
//! use std::net::UdpSocket;
//!
//! let robot = UdpSocket::bind("127.0.0.1:0")?;
//! let mut system = System::new("remote");
//! let port = udp::open(
//!     &system.devices(),
//!     "127.0.0.1:0".parse().unwrap(),
//!     Some(robot.local_addr()?),
//! )?;
//! let (speeds, receiver) = luna::channel::<[u8; 4]>();
//! let main = system.executor("main").build()?;
//! main.process("to robot").spawn(writer(&port, receiver, Framing::packets(4))?)?;
//! main.process("driver").spawn(async move { Ok(speeds.send(1.5_f32.to_le_bytes()).await?) })?;
//! # drop(port);
//! system.run()?;
//! let mut packet = [0; 10];
//! assert_eq!(robot.recv(&mut packet)?, 4);
//! # Ok::<(), luna::Error>(())
//! ```

use crate::Transport;
use luna::devices::{Device, DeviceError, DeviceManager, Holder, Sharing};
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::OwnedFd;

/// An open UDP port: see [`open`].
#[derive(Debug)]
pub struct UdpPort {
    socket: UdpSocket,
}

/// Opens the UDP port `local`; port 0 selects a free one. With a `peer` it sends to that address
/// and receives only from there; without, it receives from all, and cannot send: the first packet
/// of a writer is then the loss of the device.
///
/// The device's name is `udp:` with the given local address and the peer's: two of port 0 without a
/// peer are busy.
///
/// # Errors
///
/// A [`DeviceError`]: busy, or the system's error.
pub fn open(
    devices: &DeviceManager,
    local: SocketAddr,
    peer: Option<SocketAddr>,
) -> Result<Device<UdpPort>, DeviceError> {
    let name = match peer {
        Some(peer) => format!("udp:{local}-{peer}"),
        None => format!("udp:{local}"),
    };
    devices.open(&name, "UDP port", Sharing::Exclusive, || {
        let refused = |error| refused(&name, error);
        let socket = UdpSocket::bind(local).map_err(refused)?;
        if let Some(peer) = peer {
            socket.connect(peer).map_err(refused)?;
        }
        Ok(UdpPort { socket })
    })
}

/// What it means that the system refused a socket.
pub(crate) fn refused(name: &str, error: io::Error) -> DeviceError {
    let device = name.to_owned();
    match error.kind() {
        io::ErrorKind::AddrInUse => DeviceError::Busy {
            device,
            by: Holder::Unknown,
        },
        io::ErrorKind::AddrNotAvailable => DeviceError::Missing {
            device,
            kind: "network address of this machine",
        },
        io::ErrorKind::PermissionDenied => DeviceError::NoPermission {
            device,
            remedy: "take a port from 1024 on, or give the program CAP_NET_BIND_SERVICE".to_owned(),
        },
        _ => DeviceError::Refused {
            device,
            error: error.into(),
        },
    }
}

impl UdpPort {
    /// Its address, with the actual port.
    ///
    /// # Errors
    ///
    /// The system's error.
    pub fn local_address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Sends one packet at once, for an emergency. The links have put the socket in non-blocking
    /// mode; without a link this may block.
    ///
    /// # Errors
    ///
    /// The system's error.
    pub fn send_at_once(&self, packet: &[u8]) -> io::Result<usize> {
        self.socket.send(packet)
    }
}

impl Transport for UdpPort {
    fn file(&self) -> io::Result<OwnedFd> {
        Ok(self.socket.try_clone()?.into())
    }

    fn keeps_packets(&self) -> bool {
        true
    }
}
