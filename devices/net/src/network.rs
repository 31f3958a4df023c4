//! A connection to other computers, and the channels that are opened on it.

use crate::age::Stamped;
use crate::carrier::{Job, Running, Shared, start};
use crate::config::Config;
use crate::error::TypeInfo;
use crate::facts;
use crate::link::{Line, Link};
use crate::peering::{Accepted, Event, Memory, Own, Peering, Values};
use crate::receive_link::{Arrived, Inward};
use crate::send_link::Outward;
use crate::{NetError, ReceiveLink, Role, SendLink, Status};
use luna::{Buffer, Policy, Receiver, Sender};
use luna_platform::thread::{self, Attributes};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::HashMap;
use std::convert::Infallible;
use std::fmt;
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
    fn open(&self, entry: &Entry) -> Option<Memory> {
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
pub struct Network(Arc<Inner>);

struct Inner {
    session: Session,
    book: Book,
    lost_after: Duration,
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
    /// runs, an address is wrong, or a certificate or password was refused: set `RUST_LOG=zenoh=warn`
    /// and call `zenoh::init_log_from_env_or("warn")` to see which.
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
        Endpoint {
            network: self.clone(),
            name: name.to_owned(),
            version: 0,
            capacity: 4096,
            window: 64,
        }
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

impl fmt::Debug for Network {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Network")
            .field("book", &self.0.book)
            .finish_non_exhaustive()
    }
}

/// How a side of a channel is opened.
///
/// ```
/// # let network = luna_net::Network::open(&luna_net::Config::loopback())?;
/// let endpoint = network.endpoint("cell/setpoint").layout_version(2).capacity(64);
/// let (sender, link) = endpoint.buffered_sender::<f64>(luna::Buffer::overwrite_oldest(1))?;
/// # drop((sender, link));
/// # Ok::<(), luna_net::NetError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Endpoint {
    network: Network,
    name: String,
    version: u32,
    capacity: usize,
    window: usize,
}

impl Endpoint {
    /// The version of the value's layout, which both programs have to agree on; 0 if not stated.
    /// Count it up when the fields of the type change.
    #[must_use]
    pub fn layout_version(mut self, version: u32) -> Self {
        self.version = version;
        self
    }

    /// How many bytes a value of the sending side has at most, in postcard's format; 4096 if not
    /// stated. The buffers for that are allocated at the opening.
    #[must_use]
    pub fn capacity(mut self, bytes: usize) -> Self {
        self.capacity = bytes;
        self
    }

    /// How many values may be under way to a receiving side, or from a buffered sending side; the
    /// smaller of both counts. 64 if not stated, and at least 1.
    #[must_use]
    pub fn window(mut self, values: usize) -> Self {
        self.window = values.max(1);
        self
    }

    /// Opens the sending side of a rendezvous: a send goes on when a process of the other program
    /// has taken the value. The other program may open its side earlier or later.
    ///
    /// Not for the real-time path: it allocates, and starts a thread. While the system runs, call it
    /// in [`luna::blocking`].
    ///
    /// # Errors
    ///
    /// [`NetError::Name`]; [`NetError::Busy`] if this [`Network`] has that side open; or zenoh's
    /// error.
    pub fn sender<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
    ) -> Result<(Sender<T>, SendLink<T>), NetError> {
        self.sending(luna::channel(), 1, false)
    }

    /// Opens the sending side with a buffer in front of it: FIFO with back pressure, or overwriting.
    /// A send goes on when its value is in the buffer. The link takes values as long as fewer than
    /// the [window](Self::window) are under way; [`Status::acknowledged`] counts those that have
    /// arrived.
    ///
    /// When the last sender is gone, the link first delivers what is in the buffer. Poison, and the
    /// other program's end, drop what is in the buffer and under way. For the newest value: a buffer
    /// `overwrite_oldest(1)`, and a window of 1 or 2.
    ///
    /// # Errors
    ///
    /// As for [`sender`](Self::sender).
    pub fn buffered_sender<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
        buffer: Buffer,
    ) -> Result<(Sender<T>, SendLink<T>), NetError> {
        self.sending(luna::buffered(buffer), self.window, true)
    }

    /// Opens the receiving side: a value is acknowledged when a process has taken it, and with
    /// [`recv_extended`](Receiver::recv_extended) when that is done with it. All else is as for
    /// [`sender`](Self::sender).
    ///
    /// # Errors
    ///
    /// As there.
    pub fn receiver<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
    ) -> Result<(Receiver<T>, ReceiveLink<T>), NetError> {
        self.receiving(luna::channel(), Arrived::plain)
    }

    /// As [`receiver`](Self::receiver), and each value says how old it is.
    ///
    /// # Errors
    ///
    /// As there.
    pub fn stamped_receiver<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
    ) -> Result<(Receiver<Stamped<T>>, ReceiveLink<T, Stamped<T>>), NetError> {
        self.receiving(luna::channel(), Arrived::stamped)
    }

    /// As [`stamped_receiver`](Self::stamped_receiver), with a buffer towards the processes of this
    /// program: a value is acknowledged when it is in the buffer. With `overwrite_oldest(1)` the
    /// newest value is there whenever a process looks, and no sender waits for that.
    ///
    /// # Errors
    ///
    /// As there.
    pub fn buffered_receiver<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
        buffer: Buffer,
    ) -> Result<(Receiver<Stamped<T>>, ReceiveLink<T, Stamped<T>>), NetError> {
        self.receiving(luna::buffered(buffer), Arrived::stamped)
    }

    fn sending<T: Serialize + Send + 'static>(
        &self,
        (sender, receiver): (Sender<T>, Receiver<T>),
        buffers: usize,
        is_buffered: bool,
    ) -> Result<(Sender<T>, SendLink<T>), NetError> {
        let (give, free) = luna::buffered(Buffer::fifo(buffers));
        let give = give.external();
        for _ in 0..buffers {
            let _ = give.try_send(vec![0; self.capacity].into_boxed_slice());
        }
        let values = Values::sending(buffers, move |buffer| {
            let _ = give.try_send(buffer);
        });
        let line = self.open::<T>(Role::Sender, values, buffers)?;
        let near = Outward {
            receiver: receiver.external(),
            free: free.external(),
            buffers,
            is_buffered,
        };
        Ok((sender.named(&self.name), Link::new(line, near)))
    }

    fn receiving<T: DeserializeOwned + Send + 'static, R: Send>(
        &self,
        (sender, receiver): (Sender<R>, Receiver<R>),
        deliver_as: fn(Arrived<T>) -> R,
    ) -> Result<(Receiver<R>, ReceiveLink<T, R>), NetError> {
        let (arrive, inbox) = luna::buffered(Buffer::fifo(self.window));
        let arrive = arrive.external();
        let values = Values::receiving(self.window as u64, move |number, at, sent, bytes| {
            let value = postcard::from_bytes(bytes).map_err(|error| error.to_string())?;
            let arrived = Arrived {
                value,
                number,
                at,
                sent,
            };
            // One that finds no room is sent again.
            Ok(match arrive.try_send(arrived) {
                Ok(()) => Accepted::Yes,
                Err(_) => Accepted::Full,
            })
        });
        let line = self.open::<T>(Role::Receiver, values, 0)?;
        let near = Inward {
            sender: sender.external(),
            inbox: inbox.external(),
            deliver_as,
            quarter: (self.window as u64 / 4).max(1),
        };
        Ok((receiver.named(&self.name), Link::new(line, near)))
    }

    fn open<T>(&self, role: Role, values: Values, buffers: usize) -> Result<Line, NetError> {
        let name = self.name.clone();
        if !is_name(&name) {
            return Err(NetError::Name { name });
        }
        let Inner {
            session,
            book,
            lost_after,
            running,
        } = &*self.network.0;
        let peer = facts::here();
        let entry = (name.clone(), role);
        let Some(memory) = book.open(&entry) else {
            let holder = peer;
            return Err(NetError::Busy { name, role, holder });
        };
        let own = Own {
            name: name.clone(),
            role,
            number: facts::random(),
            info: TypeInfo {
                name: std::any::type_name::<T>().to_owned(),
                version: self.version,
            },
            peer,
            clock: facts::clock(),
            memory,
            lost_after: *lost_after,
        };
        let status = Status::default();
        let (jobs, asked) = luna::buffered::<Job>(Buffer::fifo(buffers + 4));
        // One of each kind, and one for a panic.
        let (report, events) = luna::buffered::<Event>(Buffer::fifo(4));
        let peering = Peering::new(own, status.clone(), values);
        let shared = Arc::new(Shared::new(peering, jobs.external(), report.external()));
        let started = start(
            session.clone(),
            book.clone(),
            shared.clone(),
            asked.external(),
        );
        match started {
            Ok(started) => {
                let mut running = running.lock().unwrap_or_else(PoisonError::into_inner);
                running.retain(|running| !running.thread.is_finished());
                running.push(started);
            }
            Err(error) => {
                book.close(&entry, memory);
                return Err(error);
            }
        }
        Ok(Line::new(name, shared, events.external(), status))
    }
}

/// Without the marks that have a meaning in a key of zenoh.
fn is_name(name: &str) -> bool {
    let is_allowed = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
    let is_part = |part: &str| !part.is_empty() && part.chars().all(is_allowed);
    name.len() <= 180 && name.split('/').all(is_part)
}

#[cfg(test)]
mod tests {
    use super::is_name;

    #[test]
    fn names_are_checked() {
        assert!(is_name("cell/feeder-2/ready.x"));
        let long = "x".repeat(181);
        for bad in [
            "", "/a", "a/", "a//b", "a b", "a/*", "a?b", "a#b", "@a", &long,
        ] {
            assert!(!is_name(bad), "{bad}");
        }
    }
}
