//! The receiving side: the senders, and the sink of each.

use super::wire::{Hello, Key, PeerError};
use super::{connection, datagrams};
use crate::format::{Encoder, Losing, Record, Tally, seal};
use crate::recorder::Sink;
use crate::thread::start;
use luna_platform::thread::Thread;
use std::collections::HashMap;
use std::fmt;
use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener, TcpStream, ToSocketAddrs, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The limit of known senders: those connected, and those that may come back.
const MAX_KNOWN: usize = 64;
/// A sender is refused for this long if its sink has no room. After that it may send one block as a
/// trial.
const NO_ROOM: Duration = Duration::from_secs(20);
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
        let office = Arc::new(Office {
            handler,
            known: Mutex::default(),
            turned_away: Mutex::default(),
            keeps_out: NO_ROOM,
            is_over: AtomicBool::new(false),
            visits: AtomicU64::new(0),
        });
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
        self.office.is_over.store(true, Ordering::Relaxed);
        if self.wake()
            && let Some(thread) = self.thread.take()
        {
            let _ = thread.join();
        }
        for known in std::mem::take(&mut *self.office.known()).into_values() {
            lock(&known).end();
        }
    }
}

impl Drop for Receiving {
    fn drop(&mut self) {
        self.end();
    }
}

impl fmt::Debug for Receiving {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Receiving")
            .field("address", &self.address)
            .finish_non_exhaustive()
    }
}

/// What the threads of a receiver share.
pub(super) struct Office {
    pub(super) handler: Arc<dyn Handler>,
    known: Mutex<HashMap<Key, Arc<Mutex<Known>>>>,
    /// Senders without a sink, and when one was last requested for them. At most [`MAX_KNOWN`].
    turned_away: Mutex<HashMap<Key, Instant>>,
    /// How long a sender without room is refused.
    keeps_out: Duration,
    is_over: AtomicBool,
    visits: AtomicU64,
}

/// A sender that is known.
pub(super) struct Known {
    pub(super) peer: Peer,
    /// None when it has ended.
    sink: Option<Box<dyn Sink>>,
    /// The number of the block that it has to send next.
    pub(super) next: u32,
    /// The number of the next block in what its sink takes.
    sequence: u32,
    /// The visit that uses it; a later visit takes it over. None while the sender is away.
    visit: Option<u64>,
    seen: Instant,
    /// Its sink did not take the last block.
    without_room: Option<WithoutRoom>,
    handler: Arc<dyn Handler>,
    pub(super) departure: Departure,
}

struct WithoutRoom {
    since: Instant,
    is_reported: bool,
}

/// A sender is not let in.
pub(super) struct Refusal {
    pub(super) error: PeerError,
    /// The handler has been informed.
    pub(super) is_reported: bool,
}

impl From<PeerError> for Refusal {
    fn from(error: PeerError) -> Self {
        Refusal {
            error,
            is_reported: false,
        }
    }
}

impl Refusal {
    const NO_ROOM_AS_BEFORE: Refusal = Refusal {
        error: PeerError::NoRoom,
        is_reported: true,
    };
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Office {
    pub(super) fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    fn known(&self) -> MutexGuard<'_, HashMap<Key, Arc<Mutex<Known>>>> {
        lock(&self.known)
    }

    /// Admits a sender. Returns the number of its visit, and the sender.
    pub(super) fn enter(
        &self,
        hello: &Hello,
        address: SocketAddr,
    ) -> Result<(u64, Arc<Mutex<Known>>), Refusal> {
        let visit = self.visits.fetch_add(1, Ordering::Relaxed) + 1;
        let mut all = self.known();
        if let Some(known) = all.get(&hello.key) {
            let known = known.clone();
            drop(all);
            let mut inside = lock(&known);
            let since = inside.without_room.as_ref().map(|room| room.since);
            if since.is_some_and(|since| since.elapsed() < self.keeps_out) {
                return Err(Refusal::NO_ROOM_AS_BEFORE);
            }
            inside.visit = Some(visit);
            inside.seen = Instant::now();
            if inside.sink.is_some() && since.is_none() {
                self.handler.is_back(&inside.peer);
            }
            drop(inside);
            return Ok((visit, known));
        }
        let peer = Peer {
            address,
            system: hello.system.clone(),
            process: hello.process,
            started: hello.started,
            part: hello.key.part,
        };
        let mut known = Known {
            peer,
            sink: None,
            next: 0,
            sequence: 0,
            visit: Some(visit),
            seen: Instant::now(),
            without_room: None,
            handler: self.handler.clone(),
            departure: Departure {
                has_ended: false,
                received: Tally::default(),
                missing: 0,
                error: None,
            },
        };
        // A sender that cannot continue at this block starts again with another key.
        if hello.next != 0 {
            return Ok((visit, Arc::new(Mutex::new(known))));
        }
        let asked = lock(&self.turned_away).get(&hello.key).copied();
        if asked.is_some_and(|asked| asked.elapsed() < self.keeps_out) {
            return Err(Refusal::NO_ROOM_AS_BEFORE);
        }
        if all.len() >= MAX_KNOWN && !forget_one(&mut all) {
            return Err(PeerError::Full.into());
        }
        let opened = self.handler.open(&known.peer).and_then(|mut sink| {
            sink.is_of(&known.peer.system);
            sink.begin(&Encoder::head()).map(|()| sink)
        });
        let Ok(sink) = opened else {
            self.turn_away(hello.key);
            return Err(PeerError::NoRoom.into());
        };
        known.sink = Some(sink);
        lock(&self.turned_away).remove(&hello.key);
        let known = Arc::new(Mutex::new(known));
        all.insert(hello.key, known.clone());
        Ok((visit, known))
    }

    fn turn_away(&self, key: Key) {
        let mut away = lock(&self.turned_away);
        if away.len() >= MAX_KNOWN {
            away.retain(|_, asked| asked.elapsed() < self.keeps_out);
        }
        // Beyond this number, a refused sender may ask again at once.
        if away.len() < MAX_KNOWN {
            away.insert(key, Instant::now());
        }
    }

    /// A sender has gone, unless another visit took it over.
    pub(super) fn leave(&self, visit: u64, known: &Mutex<Known>, error: Option<String>) {
        let mut known = lock(known);
        if known.visit != Some(visit) {
            return;
        }
        known.visit = None;
        known.seen = Instant::now();
        known.departure.error = error;
        let has_ended = known.departure.received.has_end;
        known.departure.has_ended = has_ended;
        if known.sink.is_none() {
            return;
        }
        if has_ended {
            known.end();
        }
        if let Some(room) = &mut known.without_room
            && std::mem::replace(&mut room.is_reported, true)
        {
            return;
        }
        self.handler.has_gone(&known.peer, &known.departure);
    }
}

/// Makes room by forgetting the sender that has been away longest. False if all are connected.
fn forget_one(all: &mut HashMap<Key, Arc<Mutex<Known>>>) -> bool {
    let away = all.iter().filter_map(|(key, known)| {
        // A locked sender's sink is at work, so it is connected.
        let known = known.try_lock().ok()?;
        known.visit.is_none().then_some((known.seen, *key))
    });
    let Some((_, key)) = away.min_by_key(|(seen, _)| *seen) else {
        return false;
    };
    if let Some(known) = all.remove(&key) {
        lock(&known).end();
    }
    true
}

impl Known {
    /// Whether a visit still has it.
    pub(super) fn is_of(&self, visit: u64) -> bool {
        self.visit == Some(visit)
    }

    /// Passes a complete block to the sink, with a number of the sink's own.
    pub(super) fn block(&mut self, block: &mut [u8]) -> io::Result<()> {
        let Some(sink) = &mut self.sink else {
            return Err(io::Error::other("the recording has ended before"));
        };
        seal(block, self.sequence);
        if let Err(error) = sink.block(block) {
            let before = self.without_room.as_ref();
            self.without_room = Some(WithoutRoom {
                since: Instant::now(),
                is_reported: before.is_some_and(|before| before.is_reported),
            });
            return Err(error);
        }
        if self
            .without_room
            .take()
            .is_some_and(|room| room.is_reported)
        {
            self.handler.is_back(&self.peer);
        }
        self.sequence = self.sequence.wrapping_add(1);
        self.departure.received.add(block);
        Ok(())
    }

    /// Writes the number of missing blocks into the recording.
    pub(super) fn record_missing(&mut self) {
        let mut encoder = Encoder::new();
        encoder.put(&Record::Losses {
            of: Losing::Blocks,
            lost: self.departure.missing,
        });
        let mut block = encoder.block().to_vec();
        // On failure, a later record has the total.
        let _ = self.block(&mut block);
    }

    fn end(&mut self) {
        if let Some(mut sink) = self.sink.take() {
            let _ = sink.end(Duration::from_secs(2));
        }
    }
}

#[cfg(test)]
mod tests;
