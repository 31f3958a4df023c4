//! The senders that a receiver knows, and the sink of each.

use super::receive::{Departure, Handler, Peer};
use super::wire::{Hello, Key, PeerError};
use crate::format::{Encoder, Losing, Record, Tally, seal};
use crate::recorder::Sink;
use std::collections::HashMap;
use std::io;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The limit of known senders: those connected, and those that may come back.
const MAX_KNOWN: usize = 64;
/// A sender is refused for this long if its sink has no room. After that it may send one block as a
/// trial.
const NO_ROOM: Duration = Duration::from_secs(20);
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
    pub(super) fn new(handler: Arc<dyn Handler>) -> Self {
        Self {
            handler,
            known: Mutex::default(),
            turned_away: Mutex::default(),
            keeps_out: NO_ROOM,
            is_over: AtomicBool::new(false),
            visits: AtomicU64::new(0),
        }
    }

    /// Lets the threads end.
    pub(super) fn stop(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }

    /// Ends the sinks of all senders.
    pub(super) fn end(&self) {
        for known in std::mem::take(&mut *self.known()).into_values() {
            lock(&known).end();
        }
    }

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
