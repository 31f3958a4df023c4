//! UDP: packets as the values of channels.
//!
//! One packet is one record, of at most as many bytes as the framing says ([`Framing::packets`](luna::external::Framing::packets)). A packet that is empty, too long, or does not decode is
//! broken; one that nobody takes at the other side is [counted](crate::Counts::refused), and no loss of the device: UDP promises nothing. What comes
//! while the channel is not read waits in the kernel's buffer, and is dropped there when that is full. Let a channel of set-points overwrite its oldest value, and let the
//! receiver time out. Where others than the peer can send, let broken packets be [dropped](crate::OnBad::Drop): else anybody can end the link with one.
//!
//! ```
//! use luna::external::Framing;
//! use luna::prelude::*;
//! use luna_links::{reader, udp, writer};
//! use std::net::UdpSocket;
//!
//! let robot = UdpSocket::bind("127.0.0.1:0")?;
//! let mut system = System::new("remote");
//! let port = udp::open(&system.devices(), "127.0.0.1:0".parse().unwrap(), Some(robot.local_addr()?))?;
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

/// Opens the UDP port `local`, whose port may be 0 for any that is free. With a `peer` it sends to that one and hears nobody else; without, it hears all, and can send
/// to none.
///
/// The device's name is `udp:` and the local address as it was given, and the peer's: two of port 0 and without a peer are busy.
///
/// # Errors
///
/// A [`DeviceError`]: busy, or what the system says.
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
    /// Its address, with the port that it has got.
    ///
    /// # Errors
    ///
    /// What the system says.
    pub fn local_address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Sends one packet, at once: for an emergency. The links have put the socket in non-blocking mode; without one this may wait for room.
    ///
    /// # Errors
    ///
    /// What the system says.
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
