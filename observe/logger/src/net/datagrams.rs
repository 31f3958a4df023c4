//! Datagrams of senders, all on one thread.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use super::office::{Known, Office, lock};
use super::receive::LOOK;
use super::wire::{Answer, DATAGRAM, Datagram, Hello, Key, PeerError, answer_bytes, u32_at};
use crate::format::{BLOCK_MAGIC, BLOCK_START, Encoder, Reader, Record, checksum, seal};
use std::collections::{HashMap, HashSet, VecDeque};
use std::net::{SocketAddr, UdpSocket};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// The most bytes of a datagram.
const MAX: usize = 64 << 10;
/// How long a sender may be silent: it declares all each second.
const SILENT: Duration = Duration::from_secs(10);
/// How many senders get a refusal before the list of refused senders is cleared.
const MAX_REFUSED: usize = 256;
/// How many are here at most.
const MAX_HERE: usize = 64;

/// A sender that is here.
struct Here {
    visit: u64,
    known: Arc<Mutex<Known>>,
    /// What it declares, so that nothing is kept that could not be read.
    reader: Reader<VecDeque<u8>>,
    sequence: u32,
    seen: Instant,
}

struct Hall<'a> {
    socket: &'a UdpSocket,
    office: &'a Office,
    here: HashMap<Key, Here>,
    refused: HashSet<SocketAddr>,
}

/// Takes datagrams until it is over.
pub(super) fn receive(socket: &UdpSocket, office: &Office) {
    let mut hall = Hall {
        socket,
        office,
        here: HashMap::new(),
        refused: HashSet::new(),
    };
    let mut buffer = vec![0; MAX];
    let mut looked = Instant::now();
    while !office.is_over() {
        // A timeout, or the kernel's report about an answer: go on with the next datagram.
        if let Ok((length, from)) = socket.recv_from(&mut buffer)
            && let Err(error) = hall.take(&mut buffer[..length], from)
        {
            hall.refuse(from, error);
        }
        if looked.elapsed() >= LOOK {
            looked = Instant::now();
            hall.dismiss_silent();
        }
    }
    for here in hall.here.into_values() {
        let error = Some("the recorder was stopped".to_owned());
        office.leave(here.visit, &here.known, error);
    }
}

impl Hall<'_> {
    fn take(&mut self, bytes: &mut [u8], from: SocketAddr) -> Result<(), PeerError> {
        let datagram = Datagram::read(bytes)?;
        let block = &mut bytes[DATAGRAM..];
        if block.len() <= BLOCK_START
            || block[..4] != BLOCK_MAGIC
            || Some(u32_at(block, 8) as usize) != block.len().checked_sub(BLOCK_START)
            || checksum(block) != u32_at(block, 12)
        {
            return Err(PeerError::Damaged("it is no block"));
        }
        let number = u32_at(block, 4);
        if !self.here.contains_key(&datagram.key) && !self.enter(datagram, block, from)? {
            return Ok(());
        }
        let Some(here) = self.here.get_mut(&datagram.key) else {
            return Ok(());
        };
        here.seen = Instant::now();
        let mut known = lock(&here.known);
        let ahead = number.wrapping_sub(known.next).cast_signed();
        if ahead < 0 {
            // It comes late, and is counted as missing; or it comes twice.
            return Ok(());
        }
        known.next = number.wrapping_add(1);
        let is_bad = !here.reader.can_read(block, &mut here.sequence);
        let missing = ahead.cast_unsigned().saturating_add(is_bad.into());
        let before = known.departure.missing;
        known.departure.missing = before.saturating_add(missing.into());
        // The difference of the numbers: how many blocks are missing before this one.
        if ahead > 0 {
            known.record_missing();
        }
        if missing == ahead.cast_unsigned() && known.block(block).is_err() {
            drop(known);
            self.dismiss(datagram.key, Some(PeerError::NoRoom.to_string()));
            return Err(PeerError::NoRoom);
        }
        Ok(())
    }

    /// A sender comes, or comes back: with what it declares, and not before.
    fn enter(
        &mut self,
        datagram: Datagram,
        block: &[u8],
        from: SocketAddr,
    ) -> Result<bool, PeerError> {
        if !Encoder::is_session(block) {
            return Ok(false);
        }
        if self.here.len() >= MAX_HERE {
            return Err(PeerError::Full);
        }
        let mut reader = new_reader();
        let mut copy = block.to_vec();
        seal(&mut copy, 0);
        reader.input().extend(&copy);
        let Ok(Some(Record::Session { system, .. })) = reader.next() else {
            return Err(PeerError::Damaged("its first record is malformed"));
        };
        let hello = Hello {
            key: datagram.key,
            next: 0,
            started: datagram.started,
            process: 0,
            system: system.to_owned(),
        };
        let entered = self.office.enter(&hello, from);
        let (visit, known) = entered.map_err(|refusal| refusal.error)?;
        {
            let mut known = lock(&known);
            // The first block of this sender: earlier blocks were not meant for this receiver.
            if known.departure.received.is_empty() {
                known.next = u32_at(block, 4);
            }
        }
        let here = Here {
            visit,
            known,
            reader: new_reader(),
            sequence: 0,
            seen: Instant::now(),
        };
        self.here.insert(datagram.key, here);
        self.answer(from, Ok(0));
        Ok(true)
    }

    fn answer(&self, to: SocketAddr, answer: Answer) {
        // A sender that does not receive the answer continues to send.
        let _ = self.socket.send_to(&answer_bytes(answer), to);
    }

    fn refuse(&mut self, from: SocketAddr, error: PeerError) {
        if self.refused.len() >= MAX_REFUSED {
            self.refused.clear();
        }
        if self.refused.insert(from) {
            // Shorter than any datagram of LUNA, so that it cannot be used to flood a third
            // computer.
            self.answer(from, Err(error));
            self.office.handler.was_refused(from, &error);
        }
    }

    fn dismiss_silent(&mut self) {
        let silent = |here: &Here| {
            let has_ended = lock(&here.known).departure.received.has_end;
            has_ended || here.seen.elapsed() >= SILENT
        };
        let gone: Vec<(Key, bool)> = self
            .here
            .iter()
            .filter(|(_, here)| silent(here))
            .map(|(key, here)| (*key, lock(&here.known).departure.received.has_end))
            .collect();
        for (key, has_ended) in gone {
            let error = (!has_ended).then(|| "it was silent for ten seconds".to_owned());
            self.dismiss(key, error);
        }
    }

    fn dismiss(&mut self, key: Key, error: Option<String>) {
        if let Some(here) = self.here.remove(&key) {
            self.office.leave(here.visit, &here.known, error);
        }
    }
}

fn new_reader() -> Reader<VecDeque<u8>> {
    Reader::new(VecDeque::from(Encoder::head())).expect("it is a head of this version")
}

impl Reader<VecDeque<u8>> {
    /// Whether a block can be read with what was declared before.
    fn can_read(&mut self, block: &[u8], sequence: &mut u32) -> bool {
        let mut copy = block.to_vec();
        seal(&mut copy, *sequence);
        *sequence = sequence.wrapping_add(1);
        self.input().extend(&copy);
        loop {
            match self.next() {
                Ok(Some(_)) => {}
                Ok(None) => return true,
                Err(_) => {
                    // The rest of it is left out: what comes next is another block.
                    self.skip_block();
                    return false;
                }
            }
        }
    }
}
