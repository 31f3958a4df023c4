//! The card on a socket, with a machine behind it and a network in front.

use crate::{Card, Faults, Network, NoWorld, Sent, World};
use luna::Policy;
use luna_platform::thread::{self, Attributes};
use std::cmp::Ordering as Order;
use std::collections::BinaryHeap;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// The period of steps of the card and the machine without packets.
const TICK: Duration = Duration::from_micros(500);

/// How a card is served.
pub struct Settings {
    /// The address to listen on; default any free port of loopback. Mesa's tool uses
    /// [`PORT`](hostmot2::PORT).
    pub address: SocketAddr,
    /// The machine behind the card.
    pub world: Box<dyn World>,
    /// What the network does.
    pub faults: Faults,
    /// The seed of its random sequence.
    pub seed: u64,
    /// The policy of its threads, if the system grants it: a real card is never late.
    pub policy: Policy,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            address: (Ipv4Addr::LOCALHOST, 0).into(),
            world: Box::new(NoWorld),
            faults: Faults::NONE,
            seed: 1,
            policy: Policy::Other,
        }
    }
}

luna_platform::debug_fields!(
    Settings, |settings|
    address: settings.address,
    faults: settings.faults,
    seed: settings.seed,
    policy: settings.policy
);

/// What has gone through the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Traffic {
    /// Packets that the card was given.
    pub requests: u64,
    /// Packets that made no sense to it.
    pub malformed: u64,
    /// The number of answers sent.
    pub answers: u64,
    /// The number of datagrams lost, both ways.
    pub lost: u64,
}

/// A card that is served, by two threads until it is dropped.
pub struct Server {
    address: SocketAddr,
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

struct Shared {
    socket: UdpSocket,
    state: Mutex<State>,
    changed: Condvar,
    is_over: AtomicBool,
}

struct State {
    card: Card,
    world: Box<dyn World>,
    network: Network,
    under_way: BinaryHeap<UnderWay>,
    number: u64,
    silent_until: u64,
    traffic: Traffic,
    answer: Vec<u8>,
}

/// A datagram that takes its time.
struct UnderWay {
    due: u64,
    number: u64,
    peer: SocketAddr,
    bytes: Vec<u8>,
    is_answer: bool,
}

impl Server {
    /// Serves a card.
    ///
    /// # Errors
    ///
    /// The address cannot be listened at.
    pub fn start(settings: Settings) -> io::Result<Self> {
        let socket = UdpSocket::bind(settings.address)?;
        let address = socket.local_addr()?;
        let shared = Arc::new(Shared {
            socket,
            state: Mutex::new(State {
                card: Card::new(),
                world: settings.world,
                network: Network::new(settings.faults, settings.seed),
                under_way: BinaryHeap::new(),
                number: 0,
                silent_until: 0,
                traffic: Traffic::default(),
                answer: Vec::new(),
            }),
            changed: Condvar::new(),
            is_over: AtomicBool::new(false),
        });
        let policy = settings.policy;
        let spawn = |name: &'static str, body: fn(&Shared)| {
            let shared = Arc::clone(&shared);
            let thread = std::thread::Builder::new().name(name.to_owned());
            thread.spawn(move || {
                if policy != Policy::Other {
                    // Without the policy the simulated card is late at times.
                    let _ = thread::apply_to_current(&Attributes::new(name).policy(policy));
                }
                body(&shared);
            })
        };
        Ok(Self {
            address,
            threads: vec![spawn("mesa-sim", listen)?, spawn("mesa-sim-tick", tick)?],
            shared,
        })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Accesses the card at this moment: its time has advanced to now (ns, of [`luna::now`]).
    pub fn with_card<R>(&self, f: impl FnOnce(&mut Card, u64) -> R) -> R {
        let mut state = self.shared.lock();
        let now = now();
        state.advance(now);
        f(&mut state.card, now)
    }

    /// Has other faults from now on.
    pub fn set_faults(&self, faults: Faults) {
        self.shared.lock().network.set_faults(faults);
    }

    /// Loses all datagrams in both directions for this time.
    pub fn silence(&self, time: Duration) {
        self.shared.lock().silent_until = now().saturating_add(time.as_nanos() as u64);
    }

    /// Powers the card off and on: it loses its state.
    pub fn power_cycle(&self) {
        self.shared.lock().card = Card::new();
    }

    /// What has gone through the network.
    pub fn traffic(&self) -> Traffic {
        self.shared.lock().traffic
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Release);
        self.shared.changed.notify_all();
        // Wakes the receiving thread with a packet.
        let local = self.shared.socket.local_addr();
        if let Ok(awakener) = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)) {
            let port = local.map_or(0, |local| local.port());
            let _ = awakener.send_to(&[], (Ipv4Addr::LOCALHOST, port));
        }
        for thread in self.threads.drain(..) {
            // A panic was reported by its hook.
            let _ = thread.join();
        }
    }
}

luna_platform::debug_fields!(Server, |server| address: server.address);

/// The machine's clock, in every system.
fn now() -> u64 {
    luna::now().as_nanos()
}

/// The thread that takes packets.
fn listen(shared: &Shared) {
    let mut bytes = [0; 2048];
    while !shared.is_over.load(Ordering::Acquire) {
        // On loopback an error reports an earlier answer that was refused.
        let Ok((length, peer)) = shared.socket.recv_from(&mut bytes) else {
            continue;
        };
        if shared.is_over.load(Ordering::Acquire) {
            return;
        }
        shared.lock().take(&bytes[..length], peer, false, shared);
    }
}

/// The thread that advances time.
fn tick(shared: &Shared) {
    let mut state = shared.lock();
    while !shared.is_over.load(Ordering::Acquire) {
        let now = now();
        while state.under_way.peek().is_some_and(|next| next.due <= now) {
            if let Some(next) = state.under_way.pop() {
                state.deliver(&next.bytes, next.peer, next.is_answer, shared);
            }
        }
        state.advance(now);
        let due = state.under_way.peek().map(|next| next.due);
        let until = due.map_or(TICK, |due| Duration::from_nanos(due.saturating_sub(now)));
        let waited = shared.changed.wait_timeout(state, until.min(TICK));
        state = waited.unwrap_or_else(PoisonError::into_inner).0;
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn advance(&mut self, now: u64) {
        self.card.advance(now);
        self.world.advance(now, &mut self.card);
    }

    /// A datagram enters the network.
    fn take(&mut self, bytes: &[u8], peer: SocketAddr, is_answer: bool, shared: &Shared) {
        let sent = match now() < self.silent_until {
            true => Sent::Lost,
            false => self.network.send(),
        };
        let mut go = |after: Duration| match after {
            Duration::ZERO => self.deliver(bytes, peer, is_answer, shared),
            after => {
                self.number += 1;
                self.under_way.push(UnderWay {
                    due: now().saturating_add(after.as_nanos() as u64),
                    number: self.number,
                    peer,
                    bytes: bytes.to_vec(),
                    is_answer,
                });
                shared.changed.notify_all();
            }
        };
        match sent {
            Sent::Lost => self.traffic.lost += 1,
            Sent::Once(after) => go(after),
            Sent::Twice(first, second) => {
                go(first);
                go(second);
            }
        }
    }

    /// A datagram leaves it.
    fn deliver(&mut self, bytes: &[u8], peer: SocketAddr, is_answer: bool, shared: &Shared) {
        let now = now();
        if now < self.silent_until {
            self.traffic.lost += 1;
        } else if is_answer {
            self.traffic.answers += 1;
            // The peer may be gone.
            let _ = shared.socket.send_to(bytes, peer);
        } else {
            self.traffic.requests += 1;
            self.advance(now);
            let mut answer = std::mem::take(&mut self.answer);
            if self.card.handle(bytes, now, &mut answer).is_err() {
                self.traffic.malformed += 1;
            }
            if !answer.is_empty() {
                self.take(&answer, peer, true, shared);
            }
            self.answer = answer;
        }
    }
}

impl PartialEq for UnderWay {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Order::Equal
    }
}

impl Eq for UnderWay {}

impl PartialOrd for UnderWay {
    fn partial_cmp(&self, other: &Self) -> Option<Order> {
        Some(self.cmp(other))
    }
}

/// The next one is the greatest.
impl Ord for UnderWay {
    fn cmp(&self, other: &Self) -> Order {
        (other.due, other.number).cmp(&(self.due, self.number))
    }
}
