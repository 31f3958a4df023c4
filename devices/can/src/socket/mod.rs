//! Interfaces of the kernel: SocketCAN.

mod frames;

use crate::filter::Kind;
use crate::{BusReport, Filter, Frame, Incoming, Port, PortError};
use frames::decode;
use luna::devices::{Device, DeviceError, DeviceManager, Sharing};
use luna::external::{readable, writable};
use luna::realtime::off_path;
use nix::sys::socket::{
    AddressFamily, ControlMessageOwned, MsgFlags, SockFlag, SockProtocol, SockType, recvmsg, socket,
};
use socketcan::SocketOptions;
use socketcan::{CanAddr, CanFilter, CanFrame, CanSocket, Socket as _};
use std::io::{self, ErrorKind, IoSliceMut};
use std::os::fd::{AsFd, AsRawFd};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// How long a frame waits that the interface's queue has no room for: that cannot be waited for.
const FULL_QUEUE: Duration = Duration::from_millis(1);

/// An interface of the kernel: see [`open`].
#[derive(Debug)]
pub struct Socket {
    socket: CanSocket,
    state: Mutex<Kept>,
}

/// What is kept between two receives.
#[derive(Debug, Default)]
struct Kept {
    /// How many frames the kernel has dropped, as it said last.
    dropped: u32,
    /// What came with such a report.
    next: Option<Incoming>,
}

/// Why an interface cannot be opened.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// There is no such interface.
    #[error(
        "there is no CAN interface `{name}`; create one with `ip link add dev {name} type vcan` for tests, or load the driver of its hardware"
    )]
    NoInterface {
        /// Its name.
        name: String,
    },
    /// The kernel has no CAN.
    #[error("this kernel has no CAN: `modprobe can_raw`, or one that is built with CONFIG_CAN_RAW")]
    NoCan,
    /// The interface is of another kind.
    #[error("the network interface `{name}` is no CAN interface")]
    OtherKind {
        /// Its name.
        name: String,
    },
    /// The device manager refuses it, or the system does.
    #[error("{0}")]
    Device(#[from] DeviceError),
}

impl From<OpenError> for luna::Error {
    fn from(error: OpenError) -> Self {
        luna::Error::other(error)
    }
}

/// Opens a CAN interface of the kernel, such as `can0`. It has to be up, and has its bit rate from
/// there: `ip link set can0 up type can bitrate 500000`.
///
/// It receives from [`Port::listen`] on, so from the start of its controller: frames from before
/// are not received.
///
/// # Errors
///
/// An [`OpenError`].
pub fn open(devices: &DeviceManager, name: &str) -> Result<Device<Socket>, OpenError> {
    let address = CanAddr::from_iface(name).map_err(|error| match error.raw_os_error() {
        Some(libc::ENODEV) => OpenError::NoInterface {
            name: name.to_owned(),
        },
        _ => failed(name, error),
    })?;
    let socket = bound(address).map_err(|error| refused(name, error))?;
    let device = format!("can:{name}");
    Ok(
        devices.open(&device, "CAN interface", Sharing::Exclusive, || {
            Ok(Socket {
                socket,
                state: Mutex::default(),
            })
        })?,
    )
}

/// A socket that has no frames yet: those from before its controller runs are not to be taken for
/// new ones.
fn bound(address: CanAddr) -> io::Result<CanSocket> {
    let flags = SockFlag::SOCK_NONBLOCK | SockFlag::SOCK_CLOEXEC;
    let raw = socket(
        AddressFamily::Can,
        SockType::Raw,
        flags,
        SockProtocol::CanRaw,
    )?;
    let socket = CanSocket::from(raw);
    socket.set_filter_drop_all()?;
    socket.set_error_filter_drop_all()?;
    socket.set_socket_option_int(libc::SOL_SOCKET, libc::SO_RXQ_OVFL, 1)?;
    socket.as_raw_socket().bind(&address.into())?;
    Ok(socket)
}

fn failed(name: &str, error: io::Error) -> OpenError {
    OpenError::Device(DeviceError::Refused {
        device: name.to_owned(),
        error: error.into(),
    })
}

fn refused(name: &str, error: io::Error) -> OpenError {
    match error.raw_os_error() {
        Some(libc::EAFNOSUPPORT | libc::EPROTONOSUPPORT) => OpenError::NoCan,
        Some(libc::ENODEV) => OpenError::OtherKind {
            name: name.to_owned(),
        },
        _ => failed(name, error),
    }
}

impl From<io::Error> for PortError {
    fn from(error: io::Error) -> Self {
        match error.raw_os_error() {
            Some(libc::ENETDOWN) => PortError::Down,
            Some(libc::ENODEV | libc::ENXIO) => PortError::Gone,
            Some(libc::ENOBUFS | libc::EAGAIN) => PortError::Full,
            _ => PortError::Failed(error.into()),
        }
    }
}

impl Port for Socket {
    const IS_OUTSIDE: bool = true;

    async fn transmit(&self, frame: Frame) -> Result<(), PortError> {
        loop {
            match off_path(|| self.write(frame)) {
                Ok(()) => return Ok(()),
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    writable(&self.socket).await.map_err(PortError::Wait)?;
                }
                Err(error) if error.raw_os_error() == Some(libc::ENOBUFS) => {
                    luna::after(FULL_QUEUE).await;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
    }

    async fn receive(&self) -> Result<Incoming, PortError> {
        loop {
            if let Some(next) = self.kept().next.take() {
                return Ok(next);
            }
            let mut bytes = [0; 16];
            match off_path(|| receive_bytes(&self.socket, &mut bytes)) {
                Ok((count, dropped)) => {
                    let mut kept = self.kept();
                    // Frames of another length are those of CAN FD, which this socket does not get.
                    kept.next = (count == bytes.len()).then(|| decode(&bytes)).flatten();
                    if let Some(dropped) = dropped {
                        let before = std::mem::replace(&mut kept.dropped, dropped);
                        let lost = dropped.wrapping_sub(before).into();
                        if lost > 0 {
                            return Ok(Incoming::Report(BusReport::new(None, lost, None)));
                        }
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    readable(&self.socket).await.map_err(PortError::Wait)?;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
    }

    fn listen(&self, filters: &[Filter]) -> Result<(), PortError> {
        self.socket.set_error_filter_accept_all()?;
        let of_kernel: Option<Vec<CanFilter>> = filters.iter().map(for_kernel).collect();
        let set = match of_kernel {
            Some(filters) => self.socket.set_filters(&filters),
            None => self.socket.set_filter_accept_all(),
        };
        match set {
            // More than the kernel takes: the controller looks at each frame anyhow.
            Err(error) if error.kind() == ErrorKind::InvalidInput => {
                Ok(self.socket.set_filter_accept_all()?)
            }
            set => Ok(set?),
        }
    }

    fn transmit_at_once(&self, frame: Frame) -> Result<(), PortError> {
        Ok(self.write(frame)?)
    }
}

impl Socket {
    fn kept(&self) -> std::sync::MutexGuard<'_, Kept> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self, frame: Frame) -> io::Result<()> {
        let made: Option<CanFrame> = match frame.is_remote() {
            true => embedded_can::Frame::new_remote(frame.id(), frame.dlc()),
            false => embedded_can::Frame::new(frame.id(), frame.data()),
        };
        let made = made.ok_or(ErrorKind::InvalidInput)?;
        self.socket.write_frame(&made)
    }
}

/// None stands for all frames.
fn for_kernel(filter: &Filter) -> Option<CanFilter> {
    // With this in the mask, frames of the other kind are kept out; remote frames are not.
    let extended = libc::CAN_EFF_FLAG;
    match filter.0 {
        Kind::Any => None,
        Kind::Standard { id, mask } => Some(CanFilter::new(id.into(), u32::from(mask) | extended)),
        Kind::Extended { id, mask } => Some(CanFilter::new(id | extended, mask | extended)),
    }
}

/// Receives one packet, and how many the kernel has dropped so far for want of room, if it says so.
fn receive_bytes(
    socket: &(impl AsFd + AsRawFd),
    bytes: &mut [u8],
) -> io::Result<(usize, Option<u32>)> {
    // Room for one message of 4 bytes, with its head.
    let mut control = [0; 64];
    let mut parts = [IoSliceMut::new(bytes)];
    let flags = MsgFlags::MSG_DONTWAIT;
    let received = recvmsg::<()>(socket.as_raw_fd(), &mut parts, Some(&mut control), flags)?;
    let dropped = received.cmsgs()?.find_map(|message| match message {
        ControlMessageOwned::RxqOvfl(dropped) => Some(dropped),
        _ => None,
    });
    Ok((received.bytes, dropped))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::UdpSocket;

    #[test]
    fn filters_of_the_kernel_tell_both_kinds_apart() {
        let short = for_kernel(&Filter::standard(0x580, 0x780)).unwrap();
        let extended = libc::CAN_EFF_FLAG;
        let raw: &libc::can_filter = short.as_ref();
        assert_eq!((raw.can_id, raw.can_mask), (0x580, 0x780 | extended));
        let long = for_kernel(&Filter::extended(0x100, 0xF00)).unwrap();
        let raw: &libc::can_filter = long.as_ref();
        assert_eq!(
            (raw.can_id, raw.can_mask),
            (0x100 | extended, 0xF00 | extended)
        );
        assert!(for_kernel(&Filter::ANY).is_none());
        // What is no part of an identifier is a flag in the kernel's filters.
        let all = for_kernel(&Filter::extended(u32::MAX, u32::MAX)).unwrap();
        let raw: &libc::can_filter = all.as_ref();
        let expected = libc::CAN_EFF_MASK | extended;
        assert_eq!((raw.can_id, raw.can_mask), (expected, expected));
        let all = for_kernel(&Filter::standard(u16::MAX, u16::MAX)).unwrap();
        let raw: &libc::can_filter = all.as_ref();
        assert_eq!((raw.can_id, raw.can_mask), (0x7FF, 0x7FF | extended));
    }

    /// The kernel counts for all kinds of packets: a UDP socket with a small queue has them too.
    #[test]
    fn packets_that_the_kernel_drops_are_counted() {
        let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
        receiver.set_nonblocking(true).unwrap();
        let queue = nix::sys::socket::sockopt::RcvBuf;
        nix::sys::socket::setsockopt(&receiver, queue, &2_048).unwrap();
        nix::sys::socket::setsockopt(&receiver, nix::sys::socket::sockopt::RxqOvfl, &1).unwrap();
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        sender.connect(receiver.local_addr().unwrap()).unwrap();
        for number in 0..1_000_u32 {
            sender.send(&number.to_ne_bytes()).unwrap();
        }
        let mut bytes = [0; 16];
        let mut received = 0;
        while receive_bytes(&receiver, &mut bytes).is_ok() {
            received += 1;
        }
        // The report comes with the next packet that has room.
        sender.send(&[0; 4]).unwrap();
        let (count, dropped) = receive_bytes(&receiver, &mut bytes).unwrap();
        assert_eq!((count, dropped), (4, Some(1_000 - received)));
    }
}
