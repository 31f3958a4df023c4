//! A packet socket of a network interface.

use crate::frame::ETHER_TYPE;
use nix::sys::socket::{self, AddressFamily, LinkAddr, SockFlag, SockType, SockaddrLike};
use std::fs::File;
use std::io::{self, ErrorKind};
use std::mem;
use std::os::fd::{AsRawFd, OwnedFd};

/// Opens a socket for the frames of EtherCAT on `interface`. It does not wait.
///
/// # Errors
///
/// The system's: no such interface, or no right to packet sockets (CAP_NET_RAW).
pub(crate) fn open(interface: &str) -> io::Result<File> {
    let index = nix::net::if_::if_nametoindex(interface)?;
    let flags = SockFlag::SOCK_NONBLOCK | SockFlag::SOCK_CLOEXEC;
    // No protocol yet: no frame of another interface comes before it is bound.
    let socket = socket::socket(AddressFamily::Packet, SockType::Raw, flags, None)?;
    bind(&socket, index)?;
    Ok(File::from(socket))
}

#[allow(unsafe_code, reason = "nix makes no address of a link from its parts")]
fn bind(socket: &OwnedFd, index: u32) -> io::Result<()> {
    // SAFETY: the structure is of integers and arrays of them, for which zeros are valid.
    let mut address: libc::sockaddr_ll = unsafe { mem::zeroed() };
    address.sll_family = libc::AF_PACKET as u16;
    address.sll_protocol = ETHER_TYPE.to_be();
    address.sll_ifindex = i32::try_from(index).map_err(|_| ErrorKind::InvalidInput)?;
    let length = mem::size_of::<libc::sockaddr_ll>() as libc::socklen_t;
    // SAFETY: the pointer is to a whole `sockaddr_ll`, whose family and length are stated, and
    // which is copied before this function returns.
    let address = unsafe { LinkAddr::from_raw((&raw const address).cast(), Some(length)) };
    let address = address.ok_or(ErrorKind::InvalidInput)?;
    Ok(socket::bind(socket.as_raw_fd(), &address)?)
}
