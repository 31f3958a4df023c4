//! The socket, as processes use it: nothing waits in the system.

use luna::Instant;
use luna::external::FileError;
use luna_machine::file;
use std::fs::File;
use std::future::{Future, poll_fn};
use std::io::{self, ErrorKind};
use std::net::UdpSocket;
use std::os::fd::OwnedFd;
use std::pin::pin;
use std::task::Poll;

/// A connected datagram socket in non-blocking mode.
#[derive(Debug)]
pub(crate) struct Socket(File);

impl Socket {
    pub(crate) fn new(socket: UdpSocket) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        Ok(Self(File::from(OwnedFd::from(socket))))
    }

    /// Sends a datagram: one system call.
    pub(crate) fn send(&self, bytes: &[u8]) -> io::Result<()> {
        file::write(&self.0, bytes).map(drop)
    }

    /// Receives the next datagram, cut to the buffer's size, if there is one: one system call.
    pub(crate) fn receive(&self, to: &mut [u8]) -> io::Result<Option<usize>> {
        match file::read(&self.0, to) {
            Ok(length) => Ok(Some(length)),
            Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Waits for a datagram, until `deadline` at most. Returns whether there may be one.
    pub(crate) async fn readable(&self, deadline: Instant) -> Result<bool, FileError> {
        let mut ready = pin!(luna::external::readable(&self.0));
        let mut late = pin!(luna::at(deadline));
        poll_fn(|cx| match ready.as_mut().poll(cx) {
            Poll::Ready(waited) => Poll::Ready(waited.map(|()| true)),
            Poll::Pending => late.as_mut().poll(cx).map(|()| Ok(false)),
        })
        .await
    }
}
