//! The server as a program has it.

use crate::sink::FoxgloveSink;
use foxglove::{Context, FoxgloveError, WebSocketServerHandle};
use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use tokio::runtime::{Builder, Runtime};

/// How many messages wait for a viewer at most. A recorder hands over a block of some thousand
/// samples at once.
const WAITING: usize = 1 << 16;

/// A server for Foxglove and Lichtblick. Dropping it ends the server.
///
/// Create it on an ordinary thread before the system runs: its thread inherits that thread's policy
/// and cores. Viewers may come and go at any time. Any client that reaches the address can look,
/// and nobody can change anything.
pub struct Foxglove {
    context: Arc<Context>,
    address: SocketAddr,
    /// Until it is dropped.
    running: Option<(WebSocketServerHandle, Runtime)>,
}

impl Foxglove {
    /// Begins to listen. Port 0 is any free one.
    ///
    /// # Errors
    ///
    /// The system's own: the address is taken, or not of this machine.
    ///
    /// # Panics
    ///
    /// In a task of tokio: it waits until the server listens.
    ///
    /// ```
    /// use luna_foxglove::Foxglove;
    ///
    /// let foxglove = Foxglove::open(([127, 0, 0, 1], 0).into())?;
    /// let taken = Foxglove::open(foxglove.address()).unwrap_err();
    /// assert_eq!(taken.kind(), std::io::ErrorKind::AddrInUse);
    /// # Ok::<(), std::io::Error>(())
    /// ```
    pub fn open(address: SocketAddr) -> io::Result<Foxglove> {
        let runtime = Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("luna-foxglove")
            .on_thread_start(luna_machine::signals::refuse_write_signals_here)
            .enable_all()
            .build()?;
        // Of its own, so that another user of the library in this program is not mixed in.
        let context = Context::new();
        let server = context
            .websocket_server()
            .name("luna")
            .bind(address.ip().to_string(), address.port())
            .message_backlog_size(WAITING);
        let server = runtime
            .block_on(server.start())
            .map_err(|error| match error {
                FoxgloveError::Bind(error) | FoxgloveError::IoError(error) => error,
                other => io::Error::other(other),
            })?;
        Ok(Foxglove {
            context,
            address: SocketAddr::new(address.ip(), server.port()),
            running: Some((server, runtime)),
        })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The address to open as a *Foxglove WebSocket* connection.
    pub fn url(&self) -> String {
        match self.address.ip() {
            ip if ip.is_unspecified() => format!("ws://localhost:{}", self.address.port()),
            _ => format!("ws://{}", self.address),
        }
    }

    /// A sink for one recording: for [`Logging::to_sink`](luna_logger::Logging::to_sink), alone or
    /// in a [`Tee`](luna_logger::Tee). Not for two recordings at a time: their topics would be one.
    pub fn sink(&self) -> FoxgloveSink {
        FoxgloveSink::new(&self.context)
    }
}

impl Drop for Foxglove {
    fn drop(&mut self) {
        if let Some((server, runtime)) = self.running.take() {
            // Its tasks end with the handle. A viewer may not be waited for.
            drop(server.stop());
            runtime.shutdown_background();
        }
    }
}

impl fmt::Debug for Foxglove {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Foxglove")
            .field("address", &self.address)
            .finish_non_exhaustive()
    }
}
