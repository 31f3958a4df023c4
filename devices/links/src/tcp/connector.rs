//! When a connection is tried again, and how one is made.

use super::{Origin, Reconnect};
use luna::external::{LinkError, OsError};
use std::io;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

/// Connects to a server again and again, for a driver of your own whose protocol needs to know when
/// a connection breaks. A [`link`](super::link()) connects by itself.
///
/// The pauses are those of [`Reconnect`]. A connection counts as a failed attempt until
/// [`useful`](Self::useful) is called for it.
///
/// ```no_run
/// use luna_links::tcp::{Connector, Reconnect};
///
/// # async fn drive() -> luna::Result<()> {
/// let mut connector = Connector::new("192.168.1.10:502".parse().unwrap(), Reconnect::default());
/// loop {
///     let stream = connector.connect().await?;
///     // Here it talks to the server, until the connection breaks.
///     connector.useful();
/// #   drop(stream);
/// }
/// # }
/// ```
#[derive(Debug)]
pub struct Connector {
    origin: Origin,
    retry: Retry,
    /// Why the last of all attempts failed.
    failed: Option<OsError>,
}

impl Connector {
    /// Nothing is connected yet.
    pub fn new(server: SocketAddr, policy: Reconnect) -> Self {
        Self {
            origin: Origin::Connect(server),
            retry: Retry::new(policy),
            failed: None,
        }
    }

    /// The next connection, after the pause that the policy asks for. Its socket blocks, and sends
    /// small records at once.
    ///
    /// Off the real-time path: a buddy thread connects. Cancel-safe: an attempt that is under way
    /// counts.
    ///
    /// # Errors
    ///
    /// When the attempts are used up: [`LinkError::NotConnected`] if the last one failed, with its
    /// error; [`LinkError::NoAttemptLeft`] if it gave a connection that was not useful, or the only
    /// one that [`Reconnect::NEVER`] allows, or was cancelled.
    pub async fn connect(&mut self) -> Result<TcpStream, LinkError> {
        let attempts = self.retry.attempts;
        if let Some(error) = self.failed {
            return Err(LinkError::NotConnected { attempts, error });
        }
        if attempts > 0 && self.retry.is_last() {
            return Err(LinkError::NoAttemptLeft { attempts });
        }
        let made = stream(&self.origin, &mut self.retry).await;
        if let Err(LinkError::NotConnected { error, .. }) = made {
            self.failed = Some(error);
        }
        made
    }

    /// The server answers over the connection: when it breaks, the next attempt is made at once.
    pub fn useful(&mut self) {
        if self.retry.policy != Reconnect::NEVER {
            self.retry = Retry::new(self.retry.policy);
            self.failed = None;
        }
    }
}

/// The number of attempts since the last useful connection, and the time of the next.
#[derive(Debug)]
pub(super) struct Retry {
    policy: Reconnect,
    attempts: u32,
    /// Before the next attempt but the first.
    pub(super) pause: Duration,
}

impl Retry {
    pub(super) fn new(policy: Reconnect) -> Self {
        Self {
            policy,
            attempts: 0,
            pause: policy.first,
        }
    }

    pub(super) fn is_last(&self) -> bool {
        self.attempts >= self.policy.attempts
    }

    /// Waits until it is time for the next attempt.
    async fn next(&mut self) {
        if self.attempts > 0 {
            luna::after(self.pause).await;
            self.pause = self.pause.saturating_mul(2).min(self.policy.longest);
        }
        self.attempts = self.attempts.saturating_add(1);
    }
}

/// A new connection.
pub(super) async fn stream(origin: &Origin, retry: &mut Retry) -> Result<TcpStream, LinkError> {
    loop {
        let made = match origin {
            Origin::Connect(server) => {
                retry.next().await;
                let (server, timeout) = (*server, retry.policy.timeout);
                // The standard library connects only by waiting, so another thread does.
                let connect = move || {
                    let stream = TcpStream::connect_timeout(&server, timeout)?;
                    // A small record must not wait for the next one.
                    stream.set_nodelay(true)?;
                    Ok(stream)
                };
                luna::blocking(connect).await
            }
            Origin::Listen(listener) => {
                let made = accept(listener).await?;
                if made.is_err() {
                    retry.next().await;
                }
                made
            }
        };
        match made {
            Ok(stream) => return Ok(stream),
            Err(error) if retry.is_last() => {
                return Err(LinkError::NotConnected {
                    attempts: retry.attempts,
                    error: error.into(),
                });
            }
            Err(_) => {}
        }
    }
}

/// The next client.
async fn accept(listener: &TcpListener) -> Result<io::Result<TcpStream>, LinkError> {
    loop {
        match luna::realtime::off_path(|| listener.accept()) {
            Ok((stream, _)) => return Ok(Ok(stream)),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                luna::external::readable(listener)
                    .await
                    .map_err(LinkError::Wait)?;
            }
            Err(error) => return Ok(Err(error)),
        }
    }
}
