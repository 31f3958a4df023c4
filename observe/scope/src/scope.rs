//! The scope as a program has it.

use crate::feed::ScopeSink;
use crate::replay::{ReplayError, Speed, play};
use crate::server;
use crate::settings::Settings;
use crate::store::Store;
use std::fmt;
use std::io::{self, Read};
use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// What the threads of a scope share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) settings: Settings,
    pub(crate) viewers: AtomicUsize,
    pub(crate) connections: AtomicUsize,
    store: Mutex<Store>,
    is_closed: Mutex<bool>,
    closed: Condvar,
}

impl Shared {
    pub(crate) fn new(settings: Settings) -> Self {
        Self {
            store: Mutex::new(Store::new(settings.memory)),
            settings,
            viewers: AtomicUsize::new(0),
            connections: AtomicUsize::new(0),
            is_closed: Mutex::new(false),
            closed: Condvar::new(),
        }
    }

    pub(crate) fn store(&self) -> MutexGuard<'_, Store> {
        self.store.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn is_closed(&self) -> bool {
        *self
            .is_closed
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits. Returns whether the scope was closed meanwhile.
    pub(crate) fn closes_within(&self, time: Duration) -> bool {
        let guard = self
            .is_closed
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let (guard, _) = self
            .closed
            .wait_timeout_while(guard, time, |is_closed| !*is_closed)
            .unwrap_or_else(PoisonError::into_inner);
        *guard
    }

    fn close(&self) {
        *self
            .is_closed
            .lock()
            .unwrap_or_else(PoisonError::into_inner) = true;
        self.closed.notify_all();
    }
}

/// A page that shows a running system, and its server. Dropping it ends the server.
///
/// Create it on an ordinary thread before the system runs: its threads inherit that thread's policy
/// and cores.
pub struct Scope {
    shared: Arc<Shared>,
    address: SocketAddr,
    acceptor: Option<JoinHandle<()>>,
}

impl Scope {
    /// Begins to listen.
    ///
    /// # Errors
    ///
    /// The system's own: the address is taken, or not of this machine.
    pub fn open(settings: Settings) -> io::Result<Scope> {
        let listener = TcpListener::bind(settings.address)?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared::new(settings));
        let acceptor = std::thread::Builder::new()
            .name("luna-scope".to_owned())
            .spawn({
                let shared = shared.clone();
                move || server::accept(&listener, &shared)
            })?;
        Ok(Scope {
            shared,
            address,
            acceptor: Some(acceptor),
        })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The address to open in the browser, with the token if there is one. The token follows a `#`;
    /// a browser does not send that part over the network.
    pub fn url(&self) -> String {
        let host = match self.address.ip() {
            ip if ip.is_unspecified() => "localhost".to_owned(),
            std::net::IpAddr::V4(ip) => ip.to_string(),
            std::net::IpAddr::V6(ip) => format!("[{ip}]"),
        };
        let token = self.shared.settings.token.as_ref();
        let token = token.map_or_else(String::new, |token| format!("#token={}", token.text()));
        format!("http://{host}:{}/{token}", self.address.port())
    }

    /// A sink for a recording's blocks. Of several, the recording that begins last is shown, alone;
    /// the blocks of the others are taken and ignored.
    ///
    /// ```
    /// use luna_logger::format::{Encoder, Record};
    /// use luna_logger::Sink;
    /// use luna_scope::{Scope, Settings};
    ///
    /// let scope = Scope::open(Settings::default().address(([127, 0, 0, 1], 0).into()))?;
    /// let mut sink = scope.sink()?;
    /// sink.begin(&Encoder::head())?;
    /// let mut encoder = Encoder::new();
    /// encoder.put(&Record::End { time: 7 });
    /// sink.block(encoder.block())?;
    /// # Ok::<(), std::io::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// The system cannot create a thread.
    pub fn sink(&self) -> io::Result<ScopeSink> {
        ScopeSink::new(&self.shared)
    }

    /// Plays a recording, and returns at its end. Viewers see its end until the scope is dropped.
    ///
    /// # Errors
    ///
    /// It is not a recording, or damaged; records before the damage are shown.
    pub fn replay(&self, recording: impl Read, speed: Speed) -> Result<(), ReplayError> {
        play(&self.shared, recording, speed)
    }

    /// How many look at it.
    pub fn viewers(&self) -> usize {
        self.shared.viewers.load(Ordering::Relaxed)
    }
}

impl Drop for Scope {
    fn drop(&mut self) {
        self.shared.close();
        // A connection of our own makes the accepting thread return and see the end.
        let mut to = self.address;
        if to.ip().is_unspecified() {
            to.set_ip(match to {
                SocketAddr::V4(_) => std::net::Ipv4Addr::LOCALHOST.into(),
                SocketAddr::V6(_) => std::net::Ipv6Addr::LOCALHOST.into(),
            });
        }
        let reached = std::net::TcpStream::connect_timeout(&to, Duration::from_secs(1)).is_ok();
        if let Some(acceptor) = self.acceptor.take().filter(|_| reached) {
            let _ = acceptor.join();
        }
    }
}

impl fmt::Debug for Scope {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Scope")
            .field("address", &self.address)
            .field("viewers", &self.viewers())
            .finish_non_exhaustive()
    }
}
