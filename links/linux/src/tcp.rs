//! TCP: one connection, kept up, as two channels.
//!
//! A [`link`] connects to a server, or waits for a client, and carries records in both directions. When the connection breaks it makes another, as
//! [`Reconnect`] says; when that fails for good the device is lost.
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

use crate::Counts;
use crate::end::{Lose, Stop};
use crate::pump::{Kind, OnBad, pump_in, pump_out};
use crate::udp::refused;
use crate::wire::Wire;
use luna::devices::{Device, DeviceError, DeviceManager, Sharing};
use luna::external::{Framing, FromBytes, LinkError, Packer, Splitter, ToBytes};
use luna::{Process, Receiver, Sender};
use std::fmt;
use std::future::{Future, poll_fn};
use std::io;
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::pin::pin;
use std::sync::Arc;
use std::task::Poll;
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

/// A server to connect to. Nothing is connected before the link runs: a server that is not there yet is awaited as [`Reconnect`] says.
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

/// A port at which clients are awaited: it listens from now on. One is served at a time; others wait in the kernel until it has gone. The port may be 0 for any that is free.
///
/// # Errors
///
/// A [`DeviceError`]: busy, or what the system says.
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
    /// The server's address, or that at which it listens.
    ///
    /// # Errors
    ///
    /// What the system says.
    pub fn address(&self) -> io::Result<SocketAddr> {
        match &self.origin {
            Origin::Connect(server) => Ok(*server),
            Origin::Listen(listener) => listener.local_addr(),
        }
    }
}

/// When a link connects again. It does not matter to one that listens, which takes the next client.
///
/// ```
/// use luna_links::tcp::Reconnect;
/// use std::time::Duration;
///
/// let patient = Reconnect::backing_off(Duration::from_millis(10), Duration::from_secs(1)).attempts(100);
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
    /// Once and never again: when the connection fails or breaks, the device is lost.
    pub const NEVER: Reconnect = Reconnect {
        first: Duration::ZERO,
        longest: Duration::ZERO,
        attempts: 1,
        timeout: Duration::from_secs(5),
    };

    /// Waits for `first` before the second attempt, twice as long before the third, and so on up to `longest`; for ever, unless [`attempts`](Self::attempts) says otherwise.
    pub const fn backing_off(first: Duration, longest: Duration) -> Self {
        Self {
            first,
            longest,
            attempts: u32::MAX,
            timeout: Duration::from_secs(5),
        }
    }

    /// The device is lost when so many attempts in a row have failed; at least one is made.
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

/// Makes a process that sends what comes from `outgoing` over the connection, and what the connection brings to `incoming`.
///
/// Records go out whole and in order. One that was under way when a connection broke is sent again over the next, from its beginning; those that only the kernel had may be lost. What came
/// in whole before a connection broke is still delivered; what was cut off is counted as [bad](Counts::bad).
///
/// When the last sender to `outgoing` is gone and all is written, the connection is closed in that direction, and the link ends when the other side closes it too. When the last receiver
/// of `incoming` is gone nothing is read any more, and the link ends when there is nothing more to send. A side that does not read holds up the senders, and nothing grows; with a
/// [patience](Link::patience) the connection is given up for it.
///
/// Real-time path: while connected, as [`reader`](crate::reader); to connect is off it, and takes a buddy thread. Cancel-safe, as [`reader`](crate::reader) is.
///
/// # Errors
///
/// The framing makes no sense.
pub fn link<O: ToBytes + Send, I: FromBytes + Send>(
    port: &Device<TcpPort>,
    outgoing: Receiver<O>,
    incoming: Sender<I>,
    framing: Framing,
) -> Result<Link<O, I>, LinkError> {
    Ok(Link {
        origin: Some(port.origin.clone()),
        device: Some(Box::new(port.clone())),
        outgoing: Some(outgoing.external()),
        incoming: Some(incoming.external()),
        splitter: Splitter::new(framing)?,
        packer: Packer::new(framing)?,
        reconnect: Reconnect::default(),
        patience: None,
        on_bad: OnBad::default(),
        sent: Counts::default(),
        received: Counts::default(),
    })
}

/// A link over TCP, to be spawned: see [`link`].
#[must_use = "a link is a process: spawn it"]
pub struct Link<O, I> {
    origin: Option<Origin>,
    device: Option<Box<dyn Lose>>,
    outgoing: Option<Receiver<O>>,
    incoming: Option<Sender<I>>,
    splitter: Splitter,
    packer: Packer,
    reconnect: Reconnect,
    patience: Option<Duration>,
    on_bad: OnBad,
    sent: Counts,
    received: Counts,
}

impl<O, I> Link<O, I> {
    /// When it connects again; without this as [`Reconnect::default`] says.
    pub fn reconnect(mut self, policy: Reconnect) -> Self {
        self.reconnect = policy;
        self
    }

    /// For how long nothing may get out before the connection is given up.
    pub fn patience(mut self, patience: Duration) -> Self {
        self.patience = Some(patience);
        self
    }

    /// What becomes of broken records that come; without this they end the link.
    pub fn on_bad(mut self, policy: OnBad) -> Self {
        self.on_bad = policy;
        self
    }

    /// What it counts of the records that come, and the connections.
    pub fn received(&self) -> Counts {
        self.received.clone()
    }

    /// What it counts of the records that go.
    pub fn sent(&self) -> Counts {
        self.sent.clone()
    }
}

impl<O: ToBytes + Send, I: FromBytes + Send> Process for Link<O, I> {
    fn run(&mut self) -> impl Future<Output = luna::Result<()>> {
        let _ = luna::prepare_files();
        async {
            let (Some(outgoing), Some(incoming), Some(device), Some(origin)) = (
                self.outgoing.take(),
                self.incoming.take(),
                &self.device,
                &self.origin,
            ) else {
                return Err(LinkError::NotPrepared.into());
            };
            let mut traffic = Traffic {
                outgoing: Some(outgoing),
                incoming: Some(incoming),
                splitter: &mut self.splitter,
                packer: &mut self.packer,
                is_unsent: false,
                patience: self.patience,
                on_bad: self.on_bad,
                sent: &self.sent,
                received: &self.received,
            };
            let stop = traffic.keep_up(origin, self.reconnect).await;
            stop.end(&**device)
        }
    }

    /// Lets go of the device.
    fn post_run(&mut self) {
        self.origin = None;
        self.device = None;
    }
}

/// What outlives a connection.
struct Traffic<'a, O, I> {
    /// Until its senders are gone.
    outgoing: Option<Receiver<O>>,
    /// Until its receivers are gone.
    incoming: Option<Sender<I>>,
    splitter: &'a mut Splitter,
    packer: &'a mut Packer,
    is_unsent: bool,
    patience: Option<Duration>,
    on_bad: OnBad,
    sent: &'a Counts,
    received: &'a Counts,
}

impl<O: ToBytes + Send, I: FromBytes + Send> Traffic<'_, O, I> {
    /// Connection after connection, until both channels have ended, or no connection can be had.
    async fn keep_up(&mut self, origin: &Origin, policy: Reconnect) -> Stop {
        loop {
            let stream = match self.stream(origin, policy).await {
                Ok(stream) => stream,
                Err(stop) => return stop,
            };
            self.received.connection();
            let broken = match self.carry(&stream).await {
                Ok(()) => return Stop::Closed,
                Err(stop @ (Stop::HungUp | Stop::Failed(_))) => stop,
                Err(stop) => return stop,
            };
            let is_over = self.outgoing.is_none();
            if is_over && matches!(broken, Stop::HungUp) {
                return Stop::Closed;
            }
            if policy == Reconnect::NEVER && matches!(origin, Origin::Connect(_)) {
                return broken;
            }
        }
    }

    /// The next connection, unless a channel is poisoned or both have ended meanwhile.
    async fn stream(&self, origin: &Origin, policy: Reconnect) -> Result<TcpStream, Stop> {
        let mut connected = pin!(stream(origin, policy));
        let mut out_ended = pin!(self.outgoing.as_ref().map(Receiver::poisoned));
        let mut in_ended = pin!(self.incoming.as_ref().map(Sender::ended));
        let mut is_in_closed = false;
        poll_fn(|cx| {
            if let Some(ended) = out_ended.as_mut().as_pin_mut()
                && ended.poll(cx).is_ready()
            {
                return Poll::Ready(Err(Stop::Poisoned));
            }
            if !is_in_closed
                && let Some(ended) = in_ended.as_mut().as_pin_mut()
                && let Poll::Ready(end) = ended.poll(cx)
            {
                match Stop::from(end) {
                    Stop::Closed if self.outgoing.is_some() => is_in_closed = true,
                    stop => return Poll::Ready(Err(stop)),
                }
            }
            connected.as_mut().poll(cx).map_err(Stop::Failed)
        })
        .await
    }

    /// Over one connection, until it breaks, or both channels have ended.
    async fn carry(&mut self, stream: &TcpStream) -> Result<(), Stop> {
        // A small record must not wait for the next one.
        let prepared = stream
            .set_nodelay(true)
            .and_then(|()| Ok((stream.try_clone()?, stream.try_clone()?)));
        let (one, other) =
            prepared.map_err(|error| Stop::Failed(LinkError::SetUp(error.into())))?;
        let (mut read_end, mut write_end) = (Wire::new(one.into())?, Wire::new(other.into())?);
        self.splitter.clear();
        let Self {
            outgoing,
            incoming,
            splitter,
            packer,
            is_unsent,
            patience,
            on_bad,
            sent,
            received,
        } = self;
        let mut out_stop = None;
        let mut in_stop = None;
        {
            let mut out = pin!(async {
                match outgoing {
                    Some(receiver) => {
                        let kind = Kind::Stream;
                        pump_out(
                            &mut write_end,
                            packer,
                            is_unsent,
                            receiver,
                            kind,
                            *patience,
                            sent,
                        )
                        .await
                    }
                    None => Stop::Closed,
                }
            });
            let mut come = pin!(async {
                match incoming {
                    Some(sender) => {
                        pump_in(
                            &mut read_end,
                            splitter,
                            sender,
                            Kind::Stream,
                            *on_bad,
                            received,
                        )
                        .await
                    }
                    None => Stop::Closed,
                }
            });
            poll_fn(|cx| {
                if out_stop.is_none()
                    && let Poll::Ready(stop) = out.as_mut().poll(cx)
                {
                    // With a connection that breaks, what came before is still read; then reading ends by itself.
                    let how = match &stop {
                        Stop::Closed => Shutdown::Write,
                        _ => Shutdown::Both,
                    };
                    let _ = stream.shutdown(how);
                    let is_final = matches!(stop, Stop::Poisoned | Stop::Record(_));
                    out_stop = Some(stop);
                    if is_final {
                        return Poll::Ready(());
                    }
                }
                if in_stop.is_none()
                    && let Poll::Ready(stop) = come.as_mut().poll(cx)
                {
                    let goes_on = matches!(stop, Stop::Closed);
                    in_stop = Some(stop);
                    if !goes_on {
                        return Poll::Ready(());
                    }
                }
                match (&out_stop, &in_stop) {
                    (Some(_), Some(_)) => Poll::Ready(()),
                    _ => Poll::Pending,
                }
            })
            .await;
        }
        if matches!(out_stop, Some(Stop::Closed)) {
            self.outgoing = None;
        }
        if matches!(in_stop, Some(Stop::Closed)) {
            self.incoming = None;
        }
        // What went wrong first in time is the cause: what is written after a reset only finds it out again.
        match (out_stop, in_stop) {
            (Some(stop @ (Stop::Poisoned | Stop::Record(_))), _)
            | (_, Some(stop @ (Stop::Poisoned | Stop::Record(_)))) => Err(stop),
            (Some(Stop::Closed) | None, Some(Stop::Closed) | None) => Ok(()),
            (Some(Stop::Closed) | None, Some(stop)) | (Some(stop), _) => Err(stop),
        }
    }
}

/// A new connection.
async fn stream(origin: &Origin, policy: Reconnect) -> Result<TcpStream, LinkError> {
    let (mut attempts, mut pause) = (0, policy.first);
    loop {
        attempts += 1;
        let made = match origin {
            Origin::Connect(server) => {
                let (server, timeout) = (*server, policy.timeout);
                // The standard library connects only by waiting, so another thread does.
                luna::blocking(move || TcpStream::connect_timeout(&server, timeout)).await
            }
            Origin::Listen(listener) => accept(listener).await?,
        };
        match made {
            Ok(stream) => return Ok(stream),
            Err(error) if attempts >= policy.attempts => {
                return Err(LinkError::NotConnected {
                    attempts,
                    error: error.into(),
                });
            }
            Err(_) => luna::after(pause).await,
        }
        pause = (pause * 2).min(policy.longest);
    }
}

/// The next client.
async fn accept(listener: &TcpListener) -> Result<io::Result<TcpStream>, LinkError> {
    loop {
        match luna::off_path(|| listener.accept()) {
            Ok((stream, _)) => return Ok(Ok(stream)),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                luna::readable(listener).await.map_err(LinkError::Wait)?;
            }
            Err(error) => return Ok(Err(error)),
        }
    }
}

impl<O, I> fmt::Debug for Link<O, I> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Link")
            .field("origin", &self.origin)
            .field("reconnect", &self.reconnect)
            .field("sent", &self.sent)
            .field("received", &self.received)
            .finish_non_exhaustive()
    }
}
