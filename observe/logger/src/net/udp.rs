//! The sending side over UDP.

use super::search::Search;
use super::tcp::check_address;
use super::wire::{ANSWER, Datagram, Key, PeerError, now, read_answer};
use crate::format::{Encoder, seal};
use crate::recorder::{Sink, UDP};
use std::collections::HashSet;
use std::io::{self, Write};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// A block is full at this size, so that a datagram usually fits an Ethernet frame.
const BLOCK: usize = 1200;
/// How often everything is declared again, for receivers that start later or lost a declaration.
const DECLARE: Duration = Duration::from_secs(1);
/// Pause between attempts to find the host.
const BACK_OFF: Duration = Duration::from_secs(2);
/// How long blocks wait for the host to be found before they are refused.
const PATIENCE: Duration = Duration::from_secs(1);

/// Sends a recording to a [`Receiver`](crate::Receiver) by UDP. Each datagram is a numbered block:
/// the receiver counts missing ones, and can read what follows a gap. Everything is declared again
/// each second, so a receiver may start at any time. Nothing waits for it.
///
/// A block counts as recorded when the kernel has taken it. A block that the kernel refuses (its
/// buffer is full, no program listens) counts as lost. A host name is resolved in the background;
/// until it is found, blocks wait one second and are then refused. A receiver of another version is
/// reported on standard error, once.
///
/// Usually made by [`Logging::to_udp`](crate::Logging::to_udp); use it directly in a
/// [`Tee`](crate::Tee).
#[derive(Debug)]
pub struct UdpSink {
    address: String,
    socket: Option<UdpSocket>,
    search: Option<Search>,
    /// When the last search ended.
    tried: Option<Instant>,
    datagram: Datagram,
    sequence: u32,
    buffer: Vec<u8>,
    declared: Option<Instant>,
    said: HashSet<PeerError>,
}

impl UdpSink {
    /// Creates a sink for `address`, `HOST:PORT`. It sends nothing yet.
    pub fn new(address: impl Into<String>) -> Self {
        Self {
            address: address.into(),
            socket: None,
            search: None,
            tried: None,
            datagram: Datagram {
                key: Key::new(),
                started: now(),
            },
            sequence: 0,
            buffer: Vec::new(),
            declared: None,
            said: HashSet::new(),
        }
    }

    /// The host's address. [`WouldBlock`](io::ErrorKind::WouldBlock) during a short first search.
    fn find(&mut self) -> io::Result<SocketAddr> {
        if let Ok(address) = self.address.parse() {
            return Ok(address);
        }
        let search = match self.search.take() {
            Some(search) => search,
            None if self.tried.is_some_and(|last| last.elapsed() < BACK_OFF) => {
                return Err(io::Error::other("the host was not found"));
            }
            None => Search::start(&self.address)?,
        };
        match search.found() {
            Some(found) => {
                self.tried = Some(Instant::now());
                found
            }
            None => {
                let is_new = self.tried.is_none() && search.begun.elapsed() < PATIENCE;
                self.search = Some(search);
                Err(match is_new {
                    true => io::ErrorKind::WouldBlock.into(),
                    false => io::Error::other("the host has not been found yet"),
                })
            }
        }
    }

    fn open(&mut self) -> io::Result<&UdpSocket> {
        if self.socket.is_none() {
            let to = self.find()?;
            let from: SocketAddr = match to {
                SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
                SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
            };
            let socket = UdpSocket::bind(from)?;
            socket.connect(to)?;
            socket.set_nonblocking(true)?;
            self.socket = Some(socket);
        }
        self.socket
            .as_ref()
            .ok_or_else(|| io::ErrorKind::NotConnected.into())
    }

    /// The error for a refused block: after `WouldBlock` the recorder would wait and offer it
    /// again.
    fn error(&self, error: io::Error) -> io::Error {
        io::Error::other(format!("{}: {error}", self.place()))
    }

    /// Reads the receiver's answer, if there is one.
    fn listen(&mut self) {
        let mut answer = [0; ANSWER];
        let got = self.socket.as_ref().map(|socket| socket.recv(&mut answer));
        if let Some(Ok(got)) = got
            && let Err(error) = read_answer(&answer[..got])
            && self.said.insert(error)
        {
            // Standard error may be closed.
            let _ = writeln!(
                io::stderr().lock(),
                "luna: recording to {}: {error}",
                self.place()
            );
        }
    }
}

impl Sink for UdpSink {
    fn place(&self) -> String {
        format!("{UDP}{}", self.address)
    }

    fn begin(&mut self, _head: &[u8]) -> io::Result<()> {
        check_address(&self.address)?;
        // Starts the search for the host, if needed. The first block reports its outcome.
        let _ = self.open();
        Ok(())
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        if let Err(error) = self.open() {
            return Err(match error.kind() {
                io::ErrorKind::WouldBlock => error,
                _ => self.error(error),
            });
        }
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.clear();
        let start = self.datagram.bytes();
        buffer.extend_from_slice(&start);
        buffer.extend_from_slice(block);
        seal(&mut buffer[start.len()..], self.sequence);
        let sent = self.open().and_then(|socket| socket.send(&buffer));
        self.buffer = buffer;
        self.listen();
        match sent {
            Ok(_) => {
                self.sequence = self.sequence.wrapping_add(1);
                if Encoder::is_session(block) {
                    self.declared = Some(Instant::now());
                }
                Ok(())
            }
            Err(error) => Err(self.error(error)),
        }
    }

    fn block_size(&self) -> usize {
        BLOCK
    }

    fn wants_declarations(&mut self) -> bool {
        let is_due = self.declared.is_some_and(|last| last.elapsed() >= DECLARE);
        if is_due {
            self.declared = None;
        }
        is_due
    }
}

#[cfg(test)]
mod tests;
