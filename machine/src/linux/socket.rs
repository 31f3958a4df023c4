//! Datagrams by calls that do not wait, whatever the socket's mode.

use std::io::{Error, Result};
use std::net::UdpSocket;
use std::os::fd::AsRawFd;

pub(crate) fn send_now(socket: &UdpSocket, bytes: &[u8]) -> Result<usize> {
    // SAFETY: the descriptor is open while it is borrowed, and the kernel reads as many bytes as
    // the slice has.
    let sent = unsafe {
        libc::send(
            socket.as_raw_fd(),
            bytes.as_ptr().cast(),
            bytes.len(),
            libc::MSG_DONTWAIT | libc::MSG_NOSIGNAL,
        )
    };
    usize::try_from(sent).map_err(|_| Error::last_os_error())
}

pub(crate) fn receive_now(socket: &UdpSocket, to: &mut [u8]) -> Result<usize> {
    // SAFETY: the descriptor is open while it is borrowed, and the kernel writes as many bytes as
    // the slice has at most.
    let received = unsafe {
        libc::recv(
            socket.as_raw_fd(),
            to.as_mut_ptr().cast(),
            to.len(),
            libc::MSG_DONTWAIT,
        )
    };
    usize::try_from(received).map_err(|_| Error::last_os_error())
}
