//! The receiving side: its threads, and what a program sees of it.

use super::office::Office;
use super::wire::PeerError;
use super::{connection, datagrams};
use crate::format::Tally;
use crate::recorder::Sink;
use crate::thread::start;
use luna_platform::thread::Thread;
use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener, TcpStream, ToSocketAddrs, UdpSocket};
use std::sync::Arc;
use std::time::Duration;

/// How often a thread looks whether it is to end.
pub(super) const LOOK: Duration = Duration::from_millis(50);

/// A program that sends its recording.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Peer {
    /// Where it is, as it came first.
    pub address: SocketAddr,
    /// The name of its system.
    pub system: String,
    /// Its process id on its computer; 0 if unknown (UDP).
    pub process: u32,
    /// When it began to record, by its own clock: nanoseconds since 1970.
    pub started: i64,
    /// 0, and one more each time that it had to start again, since the receiver did not know it any
    /// more.
    pub part: u32,
}

/// How a sender has gone.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Departure {
    /// Whether the recording has ended and is complete. Otherwise the sender may come back.
    pub has_ended: bool,
    /// What was received of it, until now.
    pub received: Tally,
    /// How many blocks are missing, by their numbers (UDP), or could not be read since a block with
    /// declarations is missing.
    pub missing: u64,
    /// What went wrong, if anything did.
    pub error: Option<String>,
}

/// Callbacks for senders. Called from several threads.
///
/// ```
/// use luna_logger::{Handler, Hub, Logging, Peer, Receiver, Recorder, Sink, WriterSink};
/// use std::sync::Arc;
///
/// struct Forget;
/// impl Handler for Forget {
///     fn open(&self, peer: &Peer) -> std::io::Result<Box<dyn Sink>> {
///         assert_eq!(peer.system, "bench");
///         Ok(Box::new(WriterSink::new(std::io::sink())))
///     }
/// }
///
/// let receiving = Receiver::tcp("127.0.0.1:0")?.start(Arc::new(Forget))?;
/// let hub = Hub::new("bench", Default::default());
/// let recording = Logging::to_tcp(receiving.address().to_string());
/// let report = Recorder::start(&hub, recording).unwrap().finish();
/// assert_eq!(report.error, None);
/// receiving.stop();
/// # Ok::<(), std::io::Error>(())
/// ```
pub trait Handler: Send + Sync + 'static {
    /// Creates the sink for a new sender. Its blocks go there, and are acknowledged when the sink
    /// has taken them.
    ///
    /// # Errors
    ///
    /// An error of the sink's: the sender is refused.
    fn open(&self, peer: &Peer) -> io::Result<Box<dyn Sink>>;

    /// A known sender has come back. If its sink had no room, it is back when the sink takes a
    /// block again.
    fn is_back(&self, _peer: &Peer) {}

    /// A sender has gone. If its sink has no room this is reported once, however often it tries.
    fn has_gone(&self, _peer: &Peer, _departure: &Departure) {}

    /// A sender was refused. Reported once for each by UDP, and by TCP once for each that is
    /// refused for lack of room.
    fn was_refused(&self, _address: SocketAddr, _error: &PeerError) {}
}

/// Receives recordings of other programs and computers, with a [`Sink`] for each.
///
/// It does not trust its peers: memory is bounded whatever they send (64 senders, with a block of
/// at most 1 MiB and 16 bytes each), and peers that do not speak its protocol are refused while the
/// others go on. There is no authentication, so listen only in trusted networks. Not for the
/// real-time path.
#[derive(Debug)]
pub struct Receiver {
    way: Way,
    address: SocketAddr,
}

#[derive(Debug)]
enum Way {
    Tcp(TcpListener),
    Udp(UdpSocket),
}

impl Receiver {
    /// Listens for [`TcpSink`](crate::TcpSink)s; port 0 selects a free one.
    ///
    /// # Errors
    ///
    /// The system's error: the address is in use, or not this machine's.
    pub fn tcp(address: impl ToSocketAddrs) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        Ok(Self {
            address: listener.local_addr()?,
            way: Way::Tcp(listener),
        })
    }

    /// Listens for [`UdpSink`](crate::UdpSink)s; port 0 selects a free one.
    ///
    /// # Errors
    ///
    /// As of [`tcp`](Self::tcp).
    pub fn udp(address: impl ToSocketAddrs) -> io::Result<Self> {
        let socket = UdpSocket::bind(address)?;
        socket.set_read_timeout(Some(LOOK))?;
        Ok(Self {
            address: socket.local_addr()?,
            way: Way::Udp(socket),
        })
    }

    /// The address that it listens on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Starts receiving, on threads of its own.
    ///
    /// # Errors
    ///
    /// A thread cannot be created.
    pub fn start(self, handler: Arc<dyn Handler>) -> io::Result<Receiving> {
        let office = Arc::new(Office::new(handler));
        let inside = office.clone();
        let is_tcp = matches!(self.way, Way::Tcp(_));
        let thread = start("luna-receiver", move || match self.way {
            Way::Tcp(listener) => connection::accept(&listener, &inside),
            Way::Udp(socket) => datagrams::receive(&socket, &inside),
        })?;
        Ok(Receiving {
            address: self.address,
            is_tcp,
            thread: Some(thread),
            office,
        })
    }
}

/// A running [`Receiver`]. Dropping it stops it.
#[must_use = "it stops when this is dropped"]
pub struct Receiving {
    address: SocketAddr,
    is_tcp: bool,
    thread: Option<Thread<()>>,
    office: Arc<Office>,
}

impl Receiving {
    /// The address that it listens on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Stops: reports the departure of all connected senders, and ends their sinks. What they took
    /// is complete.
    pub fn stop(mut self) {
        self.end();
    }

    /// Makes the thread check whether it should stop. False if that fails; then the thread is
    /// detached.
    fn wake(&self) -> bool {
        if !self.is_tcp {
            return true;
        }
        let mut address = self.address;
        if address.ip().is_unspecified() {
            address.set_ip(match address {
                SocketAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
                SocketAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
            });
        }
        TcpStream::connect_timeout(&address, Duration::from_secs(5)).is_ok()
    }

    fn end(&mut self) {
        if self.thread.is_none() {
            return;
        }
        self.office.stop();
        if self.wake()
            && let Some(thread) = self.thread.take()
        {
            let _ = thread.join();
        }
        self.office.end();
    }
}

impl Drop for Receiving {
    fn drop(&mut self) {
        self.end();
    }
}

luna_platform::debug_fields!(Receiving, |receiving| address: receiving.address);
