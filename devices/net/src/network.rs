//! A connection to other computers, and the channels that are opened on it.

use crate::carrier::Running;
use crate::config::Config;
use crate::endpoint::Endpoint;
use crate::side::Memory;
use crate::{NetError, ReceiveLink, Role, SendLink};
use luna::{Policy, Receiver, Sender};
use luna_platform::thread::{self, Attributes};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::HashMap;
use std::convert::Infallible;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use zenoh::{Session, Wait};

/// The name of a channel, and a side of it.
pub(crate) type Entry = (String, Role);

/// Which sides are open, and what is known of their sessions.
#[derive(Debug, Clone, Default)]
pub(crate) struct Book(Arc<Mutex<HashMap<Entry, (bool, Memory)>>>);

impl Book {
    fn lock(&self) -> MutexGuard<'_, HashMap<Entry, (bool, Memory)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// None if it is open.
    pub(crate) fn open(&self, entry: &Entry) -> Option<Memory> {
        let mut book = self.lock();
        let (is_open, memory) = book.entry(entry.clone()).or_default();
        (!std::mem::replace(is_open, true)).then_some(*memory)
    }

    pub(crate) fn close(&self, entry: &Entry, memory: Memory) {
        self.lock().insert(entry.clone(), (false, memory));
    }
}

/// A connection to other computers: a session of zenoh, on threads of zenoh's own without priority.
///
/// A clone is the same connection. It stays open until the last clone is dropped and the last link
/// has ended; the last drop waits for links that are ending, for about
/// [`lost_after`](Config::lost_after) at most. Not for the real-time path.
///
/// ```
/// use luna_net::{Config, Network};
///
/// let network = Network::open(&Config::loopback())?;
/// let (ready, link) = network.sender::<u32>("cell/ready")?;
/// assert!(network.sender::<u32>("cell/ready").is_err()); // there is one
/// # drop((ready, link));
/// # Ok::<(), luna_net::NetError>(())
/// ```
#[derive(Clone)]
pub struct Network(pub(crate) Arc<Inner>);

pub(crate) struct Inner {
    pub(crate) session: Session,
    pub(crate) book: Book,
    pub(crate) lost_after: Duration,
    running: Mutex<Vec<Running>>,
}

impl Network {
    /// Opens the connection. Other programs may start earlier or later, unless
    /// [`connect_within`](Config::connect_within) is stated.
    ///
    /// Not for the real-time path: it allocates, starts threads and waits for the system. zenoh's
    /// threads have no priority, also if this is called by a thread that has one.
    ///
    /// # Errors
    ///
    /// [`NetError::BeyondLoopback`], [`NetError::Config`], [`NetError::Open`].
    pub fn open(config: &Config) -> Result<Self, NetError> {
        let zenoh = config.check()?;
        let failed = |why: String| NetError::Open {
            listens: config.listens(),
            connects: config.connects(),
            why,
        };
        // zenoh's threads inherit the policy of the one that begins.
        let attributes = Attributes::new("net-open").policy(Policy::Other);
        let opening = thread::spawn(
            attributes,
            |_| Ok::<_, Infallible>(()),
            move |()| zenoh::open(zenoh).wait().map_err(|error| error.to_string()),
        );
        let opened = opening.map_err(|error| failed(error.to_string()))?.join();
        let opened = opened.unwrap_or_else(|_| Err("zenoh has panicked".to_owned()));
        Ok(Self(Arc::new(Inner {
            session: opened.map_err(failed)?,
            book: Book::default(),
            lost_after: config.time(),
            running: Mutex::default(),
        })))
    }

    /// The programs that zenoh has a connection to now. 0 for long may mean that no other program
    /// runs, an address is wrong, or a certificate or password was refused: set
    /// `RUST_LOG=zenoh=warn` and call `zenoh::init_log_from_env_or("warn")` to see which.
    pub fn connections(&self) -> usize {
        let info = self.0.session.info();
        info.peers_zid().wait().count() + info.routers_zid().wait().count()
    }

    /// Opens the sending side of the channel `name`: [`Endpoint::sender`] with the defaults.
    ///
    /// # Errors
    ///
    /// As there.
    pub fn sender<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
        name: &str,
    ) -> Result<(Sender<T>, SendLink<T>), NetError> {
        self.endpoint(name).sender()
    }

    /// Opens the receiving side of the channel `name`: [`Endpoint::receiver`] with the defaults.
    ///
    /// # Errors
    ///
    /// As there.
    pub fn receiver<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
        name: &str,
    ) -> Result<(Receiver<T>, ReceiveLink<T>), NetError> {
        self.endpoint(name).receiver()
    }

    /// How a side of the channel `name` is opened: 1 to 180 letters, digits, `_`, `-`, `.`, and `/`
    /// between two of those.
    pub fn endpoint(&self, name: &str) -> Endpoint {
        Endpoint::new(self.clone(), name)
    }
}

impl Inner {
    /// A link's thread was started.
    pub(crate) fn started(&self, started: Running) {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        running.retain(|running| !running.thread.is_finished());
        running.push(started);
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        let running = self.running.get_mut();
        for running in running.unwrap_or_else(PoisonError::into_inner).drain(..) {
            // Others have a link that lives: they keep the session open.
            if running.is_quiet.load(std::sync::atomic::Ordering::SeqCst) {
                let _ = running.thread.join();
            }
        }
    }
}

luna_platform::debug_fields!(Network, |network| book: network.0.book);
