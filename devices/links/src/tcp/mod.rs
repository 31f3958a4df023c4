//! TCP: one connection, kept open, as two channels.
//!
//! A [`link`] connects to a server, or waits for a client, and carries records in both directions.
//! When the connection breaks it makes another, according to [`Reconnect`]; when that fails for
//! good the device is lost.
//!
//! ```
//! use luna::external::{Frame, Framing};
//! use luna::prelude::*;
//! use luna_links::tcp::{self, Reconnect};
//! use std::io::{BufRead, BufReader, Write};
//! use std::net::TcpListener;
//!
//! let listener = TcpListener::bind("127.0.0.1:0")?;
//! let address = listener.local_addr()?;
//! let server = std::thread::spawn(move || {
//!     let (stream, _) = listener.accept()?;
//!     let mut line = String::new();
//!     BufReader::new(&stream).read_line(&mut line)?;
//!     (&stream).write_all(format!("you said {line}").as_bytes())
//! });
//! let mut system = System::new("client");
//! let port = tcp::connect(&system.devices(), address)?;
//! let (requests, outgoing) = luna::channel::<Frame<80>>();
//! let (incoming, replies) = luna::channel::<Frame<80>>();
//! let main = system.executor("main").build()?;
//! main.process("server").spawn(tcp::link(&port, outgoing, incoming, Framing::lines(80))?)?;
//! main.process("client").spawn(async move {
//!     requests.send(Frame::new(b"hello").unwrap()).await?;
//!     assert_eq!(replies.recv().await?.text(), Ok("you said hello"));
//!     Ok(())
//! })?;
//! # match system.run() {
//! #     Err(error) if error.to_string().contains("needs Linux") => return Ok(()),
//! #     ran => ran,
//! # }?;
//! # #[cfg(any())]
//! system.run()?;
//! server.join().unwrap()?;
//! # Ok::<(), luna::Error>(())
//! ```

mod connector;
mod link;
mod traffic;

pub use connector::Connector;
pub use link::{Link, link};

use crate::udp::refused;
use luna::devices::{Device, DeviceError, DeviceManager, Sharing};
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

/// One side of TCP connections: see [`connect`] and [`listen`].
#[derive(Debug)]
pub struct TcpPort {
    origin: Origin,
}

/// Where connections come from.
#[derive(Debug, Clone)]
enum Origin {
    Connect(SocketAddr),
    Listen(Arc<TcpListener>),
}

/// A server to connect to. Nothing is connected before the link runs: an unreachable server is
/// tried again according to [`Reconnect`].
///
/// # Errors
///
/// [`DeviceError::Busy`]: another link of the system connects to it.
pub fn connect(
    devices: &DeviceManager,
    server: SocketAddr,
) -> Result<Device<TcpPort>, DeviceError> {
    let name = format!("tcp:{server}");
    devices.open(&name, "TCP connection", Sharing::Exclusive, || {
        Ok(TcpPort {
            origin: Origin::Connect(server),
        })
    })
}

/// A port for clients: it listens from now on. One client is served at a time; others wait in the
/// kernel. Port 0 selects a free one.
///
/// # Errors
///
/// A [`DeviceError`]: busy, or the system's error.
pub fn listen(devices: &DeviceManager, local: SocketAddr) -> Result<Device<TcpPort>, DeviceError> {
    let name = format!("tcp-listen:{local}");
    devices.open(&name, "TCP port", Sharing::Exclusive, || {
        let listener = TcpListener::bind(local).map_err(|error| refused(&name, error))?;
        listener
            .set_nonblocking(true)
            .map_err(|error| refused(&name, error))?;
        Ok(TcpPort {
            origin: Origin::Listen(Arc::new(listener)),
        })
    })
}

impl TcpPort {
    /// The server's address, or the address that it listens on.
    ///
    /// # Errors
    ///
    /// The system's error.
    pub fn address(&self) -> io::Result<SocketAddr> {
        match &self.origin {
            Origin::Connect(server) => Ok(*server),
            Origin::Listen(listener) => listener.local_addr(),
        }
    }
}

/// When a link connects again. It does not apply to a listening link, which takes the next client.
///
/// After a useful connection the next attempt is made at once. A connection counts as a failed
/// attempt if no record was received over it, and none was sent before it broke within the pause:
/// so a server that accepts and closes at once is not asked without a pause.
///
/// ```
/// use luna_links::tcp::Reconnect;
/// use std::time::Duration;
///
/// let patient =
///     Reconnect::backing_off(Duration::from_millis(10), Duration::from_secs(1)).attempts(100);
/// # let _ = patient;
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reconnect {
    first: Duration,
    longest: Duration,
    attempts: u32,
    timeout: Duration,
}

impl Reconnect {
    /// Never again: when the connection fails or breaks, the device is lost.
    pub const NEVER: Reconnect = Reconnect {
        first: Duration::ZERO,
        longest: Duration::ZERO,
        attempts: 1,
        timeout: Duration::from_secs(5),
    };

    /// Waits for `first` before the second attempt, twice as long before the third, and so on up to
    /// `longest`; for ever, unless [`attempts`](Self::attempts) sets a limit.
    pub const fn backing_off(first: Duration, longest: Duration) -> Self {
        Self {
            first,
            longest,
            attempts: u32::MAX,
            timeout: Duration::from_secs(5),
        }
    }

    /// The device is lost when this many attempts in a row have failed, including useless
    /// connections; at least one is made.
    #[must_use]
    pub const fn attempts(mut self, attempts: u32) -> Self {
        self.attempts = attempts;
        self
    }

    /// How long an attempt may take; 5 s if not stated.
    #[must_use]
    pub const fn timeout(mut self, timeout: Duration) -> Self {
        self.timeout = timeout;
        self
    }
}

impl Default for Reconnect {
    /// From 100 ms to 5 s, for ever.
    fn default() -> Self {
        Self::backing_off(Duration::from_millis(100), Duration::from_secs(5))
    }
}
