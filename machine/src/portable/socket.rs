//! Datagrams by calls that do not wait: the standard library sets the socket's mode around them.

use std::io::Result;
use std::net::UdpSocket;

pub(crate) fn send_now(socket: &UdpSocket, bytes: &[u8]) -> Result<usize> {
    without_waiting(socket, |socket| socket.send(bytes))
}

pub(crate) fn receive_now(socket: &UdpSocket, to: &mut [u8]) -> Result<usize> {
    without_waiting(socket, |socket| socket.recv(to))
}

fn without_waiting(
    socket: &UdpSocket,
    call: impl FnOnce(&UdpSocket) -> Result<usize>,
) -> Result<usize> {
    socket.set_nonblocking(true)?;
    let outcome = call(socket);
    socket.set_nonblocking(false)?;
    outcome
}
