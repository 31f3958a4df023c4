//! A bad network between two programs: a relay that they connect through. It loses datagrams,
//! delays what it carries, and can be cut. It needs no privilege, and nothing of the kernel.

use crate::shared::Random;
use std::collections::{BinaryHeap, HashMap};
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

/// How long a thread waits for input before it looks whether the relay has gone.
const LOOK: Duration = Duration::from_millis(200);

/// What a relay does to what it carries.
#[derive(Clone, Copy)]
pub(crate) struct Weather {
    /// How many datagrams of 256 are lost. A stream of TCP loses nothing.
    pub(crate) loss: u8,
    pub(crate) delay: Duration,
    /// By how much the delay differs at most. So datagrams change places; TCP keeps its order.
    pub(crate) spread: Duration,
}

/// It ends when dropped.
pub(crate) struct Relay {
    state: Arc<State>,
    address: SocketAddr,
}

struct State {
    weather: Weather,
    random: Mutex<Random>,
    /// What is under way, with whether the relay is cut.
    air: Mutex<(BinaryHeap<Item>, bool)>,
    changed: Condvar,
    has_ended: AtomicBool,
    count: AtomicU64,
    lost: AtomicU64,
}

/// What is under way.
struct Item {
    due: Instant,
    number: u64,
    bytes: Vec<u8>,
    to: Target,
}

enum Target {
    /// A datagram, to the peer of the socket or to an address.
    Datagram(Arc<UdpSocket>, Option<SocketAddr>),
    /// Part of a stream; without bytes its end.
    Stream(Arc<TcpStream>),
}

impl Ord for Item {
    /// The greatest of a heap comes first: the earliest.
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (other.due, other.number).cmp(&(self.due, self.number))
    }
}

impl PartialOrd for Item {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Item {
    fn eq(&self, other: &Self) -> bool {
        self.number == other.number
    }
}

impl Eq for Item {}

impl Relay {
    fn new(weather: Weather, random: Random, address: SocketAddr) -> Self {
        let state = Arc::new(State {
            weather,
            random: Mutex::new(random),
            air: Mutex::default(),
            changed: Condvar::new(),
            has_ended: AtomicBool::new(false),
            count: AtomicU64::new(0),
            lost: AtomicU64::new(0),
        });
        let carrying = state.clone();
        std::thread::spawn(move || carrying.carry());
        Self { state, address }
    }

    /// For datagrams to a program at `target`.
    pub(crate) fn udp(weather: Weather, random: Random, target: SocketAddr) -> Self {
        let front = UdpSocket::bind("127.0.0.1:0").unwrap();
        let relay = Self::new(weather, random, front.local_addr().unwrap());
        let state = relay.state.clone();
        std::thread::spawn(move || state.take_datagrams(front, target));
        relay
    }

    /// For connections to a program at `target`.
    pub(crate) fn tcp(weather: Weather, random: Random, target: SocketAddr) -> Self {
        let front = TcpListener::bind("127.0.0.1:0").unwrap();
        let relay = Self::new(weather, random, front.local_addr().unwrap());
        let state = relay.state.clone();
        std::thread::spawn(move || state.take_connections(&front, target));
        relay
    }

    /// Where a program connects to.
    pub(crate) fn address(&self) -> SocketAddr {
        self.address
    }

    /// Cuts the network, or mends it. Datagrams are lost meanwhile; what is in a stream comes
    /// after it, as TCP sends it again.
    pub(crate) fn cut(&self, is_cut: bool) {
        self.state.air.lock().unwrap().1 = is_cut;
        self.state.changed.notify_all();
    }

    /// How many packets it has carried, and how many datagrams it has lost.
    pub(crate) fn counts(&self) -> (u64, u64) {
        let lost = self.state.lost.load(SeqCst);
        (self.state.count.load(SeqCst) - lost, lost)
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.state.has_ended.store(true, SeqCst);
        self.cut(false);
        // Wakes the thread that waits for connections, if there is one.
        drop(TcpStream::connect_timeout(&self.address, LOOK));
    }
}

/// Whether there was no input in time.
fn is_none(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
}

impl State {
    fn has_ended(&self) -> bool {
        self.has_ended.load(SeqCst)
    }

    /// Puts something under way, not to arrive before `earliest`; when it is due.
    fn put(&self, bytes: &[u8], to: Target, earliest: Instant) -> Instant {
        let Weather { delay, spread, .. } = self.weather;
        let shift = {
            let mut random = self.random.lock().unwrap();
            Duration::from_nanos(random.below(2 * spread.as_nanos() as u64 + 1))
        };
        let due = earliest.max(Instant::now() + delay + shift - spread);
        let item = Item {
            due,
            number: self.count.fetch_add(1, SeqCst),
            bytes: bytes.to_vec(),
            to,
        };
        self.air.lock().unwrap().0.push(item);
        self.changed.notify_all();
        due
    }

    /// Lets arrive what is due.
    fn carry(&self) {
        let mut air = self.air.lock().unwrap();
        while !self.has_ended() {
            let now = Instant::now();
            let (items, is_cut) = &mut *air;
            let is_held = |item: &Item| *is_cut && matches!(item.to, Target::Stream(_));
            let next = items.peek().filter(|item| !is_held(item));
            let wait = next.map_or(LOOK, |item| item.due.saturating_duration_since(now));
            if !wait.is_zero() {
                air = self.changed.wait_timeout(air, wait).unwrap().0;
                continue;
            }
            let (item, is_cut) = (items.pop().unwrap(), *is_cut);
            drop(air);
            self.arrive(&item, is_cut);
            air = self.air.lock().unwrap();
        }
    }

    fn arrive(&self, item: &Item, is_cut: bool) {
        match &item.to {
            Target::Datagram(socket, to) => {
                let is_lost = is_cut || self.random.lock().unwrap().chance(self.weather.loss);
                if is_lost {
                    self.lost.fetch_add(1, SeqCst);
                    return;
                }
                // Nobody may be there now.
                let _ = match to {
                    Some(to) => socket.send_to(&item.bytes, to),
                    None => socket.send(&item.bytes),
                };
            }
            Target::Stream(stream) => {
                let mut writer = &**stream;
                if item.bytes.is_empty() || writer.write_all(&item.bytes).is_err() {
                    let _ = stream.shutdown(Shutdown::Both);
                }
            }
        }
    }

    fn take_datagrams(self: Arc<Self>, front: UdpSocket, target: SocketAddr) {
        let front = Arc::new(front);
        front.set_read_timeout(Some(LOOK)).unwrap();
        let mut backs: HashMap<SocketAddr, Arc<UdpSocket>> = HashMap::new();
        let mut buffer = vec![0; 65536];
        while !self.has_ended() {
            let Ok((length, from)) = front.recv_from(&mut buffer) else {
                continue;
            };
            let back = backs.entry(from).or_insert_with(|| {
                let back = Arc::new(UdpSocket::bind("127.0.0.1:0").unwrap());
                back.connect(target).unwrap();
                back.set_read_timeout(Some(LOOK)).unwrap();
                let (state, answers, front) = (self.clone(), back.clone(), front.clone());
                std::thread::spawn(move || {
                    let mut buffer = vec![0; 65536];
                    while !state.has_ended() {
                        if let Ok(length) = answers.recv(&mut buffer) {
                            let to = Target::Datagram(front.clone(), Some(from));
                            state.put(&buffer[..length], to, Instant::now());
                        }
                    }
                });
                back
            });
            let to = Target::Datagram(back.clone(), None);
            self.put(&buffer[..length], to, Instant::now());
        }
    }

    fn take_connections(self: Arc<Self>, front: &TcpListener, target: SocketAddr) {
        while let Ok((near, _)) = front.accept() {
            if self.has_ended() {
                return;
            }
            // Otherwise the program is not there, and the connection ends.
            if let Ok(far) = TcpStream::connect(target) {
                let (near, far) = (Arc::new(near), Arc::new(far));
                for (from, to) in [(near.clone(), far.clone()), (far, near)] {
                    let state = self.clone();
                    std::thread::spawn(move || state.take_stream(&from, &to));
                }
            }
        }
    }

    fn take_stream(&self, mut from: &TcpStream, to: &Arc<TcpStream>) {
        from.set_read_timeout(Some(LOOK)).unwrap();
        from.set_nodelay(true).unwrap();
        let mut buffer = vec![0; 65536];
        let mut earliest = Instant::now();
        while !self.has_ended() {
            let length = match from.read(&mut buffer) {
                Ok(length) => length,
                Err(error) if is_none(&error) => continue,
                Err(_) => 0,
            };
            let to = Target::Stream(to.clone());
            earliest = self.put(&buffer[..length], to, earliest);
            if length == 0 {
                return;
            }
        }
    }
}
