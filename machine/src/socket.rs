//! Datagrams of a connected UDP socket: by calls that never wait, beside one that may.
//!
//! The socket stays in blocking mode. So one user of it can send without waiting in each cycle, and
//! receive by a call that sleeps in the kernel: one system call for a datagram, where a file that
//! is waited for takes three.

use crate::backend::socket as backend;
use luna_platform::path::{self, Call};
use std::io::{ErrorKind, Result};
use std::net::UdpSocket;

/// Sends a datagram to the connected address, without waiting. Real-time path: one system call,
/// more only if signals come; it allocates nothing.
///
/// On the portable backend the socket's mode is changed for the call, so another user of the same
/// socket must not wait meanwhile.
///
/// # Errors
///
/// The error of the system: [`WouldBlock`](ErrorKind::WouldBlock) if the socket's buffer is full,
/// [`ConnectionRefused`](ErrorKind::ConnectionRefused) if no program has the address that an
/// earlier datagram was sent to.
///
/// ```
/// use std::net::UdpSocket;
///
/// let (near, far) = (UdpSocket::bind("127.0.0.1:0")?, UdpSocket::bind("127.0.0.1:0")?);
/// near.connect(far.local_addr()?)?;
/// assert_eq!(luna_machine::socket::send_now(&near, b"value")?, 5);
/// assert_eq!(far.recv(&mut [0; 9])?, 5);
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn send_now(socket: &UdpSocket, bytes: &[u8]) -> Result<usize> {
    unless_interrupted(Call::File, || backend::send_now(socket, bytes))
}

/// Receives the next datagram, cut to the size of `to`, without waiting. Real-time path: as
/// [`send_now`].
///
/// # Errors
///
/// The error of the system: [`WouldBlock`](ErrorKind::WouldBlock) if there is none.
///
/// ```
/// use std::io::ErrorKind;
/// use std::net::UdpSocket;
///
/// let near = UdpSocket::bind("127.0.0.1:0")?;
/// let nothing = luna_machine::socket::receive_now(&near, &mut [0; 9]);
/// assert_eq!(nothing.unwrap_err().kind(), ErrorKind::WouldBlock);
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn receive_now(socket: &UdpSocket, to: &mut [u8]) -> Result<usize> {
    unless_interrupted(Call::File, || backend::receive_now(socket, to))
}

/// Receives the next datagram, cut to the size of `to`; sleeps in the kernel until there is one,
/// for the socket's read timeout at most. For a thread that has nothing else to do: one system
/// call.
///
/// # Errors
///
/// The error of the system: [`WouldBlock`](ErrorKind::WouldBlock) if none came in time. A signal
/// begins the time anew.
///
/// ```
/// use std::net::UdpSocket;
///
/// let (near, far) = (UdpSocket::bind("127.0.0.1:0")?, UdpSocket::bind("127.0.0.1:0")?);
/// far.send_to(b"value", near.local_addr()?)?;
/// assert_eq!(luna_machine::socket::receive(&near, &mut [0; 9])?, 5);
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn receive(socket: &UdpSocket, to: &mut [u8]) -> Result<usize> {
    unless_interrupted(Call::Sleep, || socket.recv(to))
}

/// Makes a system call of the path, again as long as signals interrupt it.
pub(crate) fn unless_interrupted(
    reason: Call,
    mut call: impl FnMut() -> Result<usize>,
) -> Result<usize> {
    loop {
        match path::expected(reason, &mut call) {
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            outcome => return outcome,
        }
    }
}
