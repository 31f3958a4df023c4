//! Interfaces of the kernel: SocketCAN.

use crate::filter::Kind;
use crate::{BusError, BusReport, Filter, Frame, Incoming, Port, PortError, State};
use embedded_can::{ExtendedId, StandardId};
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

/// The kernel's `struct can_frame`.
fn decode(bytes: &[u8; 16]) -> Option<Incoming> {
    let [a, b, c, d, len, _, _, _, data @ ..] = *bytes;
    let id = u32::from_ne_bytes([a, b, c, d]);
    let len = usize::from(len).min(8);
    if id & libc::CAN_ERR_FLAG != 0 {
        let report = report(id & libc::CAN_ERR_MASK, &data);
        return Some(Incoming::Report(report));
    }
    let is_remote = id & libc::CAN_RTR_FLAG != 0;
    let id: embedded_can::Id = match id & libc::CAN_EFF_FLAG {
        0 => StandardId::new((id & libc::CAN_SFF_MASK) as u16)?.into(),
        _ => ExtendedId::new(id & libc::CAN_EFF_MASK)?.into(),
    };
    let frame = match is_remote {
        true => Frame::remote(id, len),
        false => Frame::new(id, &data[..len]),
    };
    frame.map(Incoming::Frame)
}

/// What an error frame says, by its classes (`linux/can/error.h`). It is decoded here, since the
/// list of causes that `socketcan` makes of one is on the heap when they are more than two.
fn report(classes: u32, data: &[u8; 8]) -> BusReport {
    let mut report = BusReport::default();
    let has = |class: u32| classes & class != 0;
    if has(libc::CAN_ERR_CRTL) {
        let problems = i32::from(data[1]);
        let has = |some: i32| problems & some != 0;
        report.lost = has(libc::CAN_ERR_CRTL_RX_OVERFLOW | libc::CAN_ERR_CRTL_TX_OVERFLOW).into();
        report.state = if has(libc::CAN_ERR_CRTL_RX_PASSIVE | libc::CAN_ERR_CRTL_TX_PASSIVE) {
            Some(State::Passive)
        } else if has(libc::CAN_ERR_CRTL_RX_WARNING | libc::CAN_ERR_CRTL_TX_WARNING) {
            Some(State::Warning)
        } else if has(libc::CAN_ERR_CRTL_ACTIVE) {
            Some(State::Active)
        } else {
            None
        };
    }
    if has(libc::CAN_ERR_BUSOFF) {
        report.state = Some(State::BusOff);
    }
    if has(libc::CAN_ERR_RESTARTED) {
        report.state = Some(State::Active);
    }
    // A frame that has lost arbitration is sent again: no error.
    report.error = if has(libc::CAN_ERR_ACK) {
        Some(BusError::NotAcknowledged)
    } else if has(libc::CAN_ERR_TRX) {
        Some(BusError::Transceiver)
    } else if has(libc::CAN_ERR_PROT) {
        Some(BusError::Protocol)
    } else if has(libc::CAN_ERR_TX_TIMEOUT) {
        Some(BusError::TransmitTimeout)
    } else if has(libc::CAN_ERR_BUSERROR) || classes & !KNOWN != 0 || classes == 0 {
        Some(BusError::Other)
    } else {
        None
    };
    report
}

/// The classes of error frames that have a meaning here.
const KNOWN: u32 = libc::CAN_ERR_TX_TIMEOUT
    | libc::CAN_ERR_LOSTARB
    | libc::CAN_ERR_CRTL
    | libc::CAN_ERR_PROT
    | libc::CAN_ERR_TRX
    | libc::CAN_ERR_ACK
    | libc::CAN_ERR_BUSOFF
    | libc::CAN_ERR_BUSERROR
    | libc::CAN_ERR_RESTARTED
    | libc::CAN_ERR_CNT;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::net::UdpSocket;

    fn kernel(id: u32, data: &[u8]) -> [u8; 16] {
        let mut bytes = [0; 16];
        bytes[..4].copy_from_slice(&id.to_ne_bytes());
        bytes[4] = data.len() as u8;
        bytes[8..8 + data.len()].copy_from_slice(data);
        bytes
    }

    #[test]
    fn frames_of_the_kernel_are_decoded() {
        let plain = Frame::standard(0x123, &[1, 2]).unwrap();
        let decoded = decode(&kernel(0x123, &[1, 2]));
        assert_eq!(decoded, Some(Incoming::Frame(plain)));
        let long = Frame::extended(0x1234_5678, &[3]).unwrap();
        let decoded = decode(&kernel(0x1234_5678 | libc::CAN_EFF_FLAG, &[3]));
        assert_eq!(decoded, Some(Incoming::Frame(long)));
        let request = Frame::remote(StandardId::new(5).unwrap(), 4).unwrap();
        let decoded = decode(&kernel(5 | libc::CAN_RTR_FLAG, &[0; 4]));
        assert_eq!(decoded, Some(Incoming::Frame(request)));
    }

    #[test]
    fn error_frames_of_the_kernel_are_reports() {
        let decoded = |id: u32, data: [u8; 8]| match decode(&kernel(id | libc::CAN_ERR_FLAG, &data))
        {
            Some(Incoming::Report(report)) => report,
            other => panic!("{other:?}"),
        };
        let off = decoded(libc::CAN_ERR_BUSOFF, [0; 8]);
        assert_eq!(off, BusReport::new(Some(State::BusOff), 0, None));
        let passive = decoded(
            libc::CAN_ERR_CRTL | libc::CAN_ERR_CNT,
            [0, 0x10, 0, 0, 0, 0, 1, 129],
        );
        assert_eq!(passive, BusReport::new(Some(State::Passive), 0, None));
        let alone = decoded(libc::CAN_ERR_ACK, [0; 8]);
        let error = Some(BusError::NotAcknowledged);
        assert_eq!(alone, BusReport::new(None, 0, error));
        let overrun = decoded(libc::CAN_ERR_CRTL, [0, 1, 0, 0, 0, 0, 0, 0]);
        assert_eq!(overrun, BusReport::new(None, 1, None));
        let back = decoded(libc::CAN_ERR_RESTARTED, [0; 8]);
        assert_eq!(back, BusReport::new(Some(State::Active), 0, None));
        // Many causes at once: a wrong bit, no acknowledgement, counters, and a state.
        let classes = libc::CAN_ERR_PROT | libc::CAN_ERR_ACK | libc::CAN_ERR_BUSERROR;
        let classes = classes | libc::CAN_ERR_CRTL | libc::CAN_ERR_CNT;
        let many = decoded(classes, [0, 0x04, 1, 0, 0, 0, 97, 0]);
        assert_eq!(many, BusReport::new(Some(State::Warning), 0, error));
        for (class, error) in [
            (libc::CAN_ERR_LOSTARB, None),
            (libc::CAN_ERR_CNT, None),
            (libc::CAN_ERR_PROT, Some(BusError::Protocol)),
            (libc::CAN_ERR_TRX, Some(BusError::Transceiver)),
            (libc::CAN_ERR_TX_TIMEOUT, Some(BusError::TransmitTimeout)),
            (libc::CAN_ERR_BUSERROR, Some(BusError::Other)),
            (1 << 20, Some(BusError::Other)),
            (0, Some(BusError::Other)),
        ] {
            let report = BusReport::new(None, 0, error);
            assert_eq!(decoded(class, [0; 8]), report, "{class:X}");
        }
    }

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

    proptest! {
        #[test]
        fn any_bytes_of_the_kernel_are_decoded(bytes: [u8; 16]) {
            let _ = decode(&bytes);
        }

        #[test]
        fn what_is_sent_is_what_comes(id in 0..0x2000_0000_u32, is_long: bool, data in prop::collection::vec(any::<u8>(), 0..=8)) {
            let (frame, raw) = match is_long {
                true => (Frame::extended(id, &data), id | libc::CAN_EFF_FLAG),
                false => (Frame::standard((id & 0x7FF) as u16, &data), id & 0x7FF),
            };
            prop_assert_eq!(decode(&kernel(raw, &data)), frame.map(Incoming::Frame));
        }
    }
}
