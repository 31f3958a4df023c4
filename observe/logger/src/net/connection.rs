//! TCP connections of senders, a thread each.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use super::office::{Known, Office, Refusal, lock};
use super::receive::LOOK;
use super::timed;
use super::wire::{
    Answer, HELLO, Hello, MAGIC, PREFIX, PeerError, ack_bytes, answer_bytes, check_prefix, u32_at,
};
use crate::format::{BLOCK_MAGIC, BLOCK_START, MAX_IN_BLOCK, checksum};
use crate::thread::start;
use luna_platform::thread::Thread;
use std::io::{self, ErrorKind, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// How many connections at a time.
const MAX: usize = 64;
/// How long a hello may take, and the longest silence of a sender, which sends the time of day
/// every ten seconds.
const HELLO_WITHIN: Duration = Duration::from_secs(5);
const SILENT: Duration = Duration::from_secs(60);
/// How long an acknowledgement may take.
const ACK_WITHIN: Duration = Duration::from_secs(5);

/// Takes connections until it is over.
pub(super) fn accept(listener: &TcpListener, office: &Arc<Office>) {
    let mut threads: Vec<Thread<()>> = Vec::new();
    while !office.is_over() {
        threads.retain(|thread| !thread.is_finished());
        let Ok((stream, address)) = listener.accept() else {
            // The peer has closed again, or no file descriptors are left. The latter passes.
            std::thread::sleep(LOOK);
            continue;
        };
        if office.is_over() || stream.set_nodelay(true).is_err() {
            continue;
        }
        if threads.len() >= MAX {
            answer_no(&stream, PeerError::Full);
            office.handler.was_refused(address, &PeerError::Full);
            continue;
        }
        let inside = office.clone();
        threads.extend(start("luna-receiver-tcp", move || {
            serve(&inside, stream, address);
        }));
    }
    for thread in threads {
        let _ = thread.join();
    }
}

fn answer_no(mut stream: &TcpStream, error: PeerError) {
    let _ = stream.set_write_timeout(Some(ACK_WITHIN));
    let _ = stream.write_all(&answer_bytes(Err(error)));
}

fn serve(office: &Office, stream: TcpStream, address: SocketAddr) {
    let stream = Stream { stream, office };
    let entered = stream
        .hello()
        .map_err(Refusal::from)
        .and_then(|hello| office.enter(&hello, address));
    let (visit, known) = match entered {
        Ok(entered) => entered,
        Err(Refusal { error, is_reported }) => {
            answer_no(&stream.stream, error);
            if !is_reported {
                office.handler.was_refused(address, &error);
            }
            return;
        }
    };
    let outcome = stream.blocks(visit, &known);
    let error = match outcome {
        Ok(()) => None,
        Err(error) => Some(error.to_string()),
    };
    office.leave(visit, &known, error);
}

struct Stream<'a> {
    stream: TcpStream,
    office: &'a Office,
}

impl Stream<'_> {
    /// The sender's hello.
    fn hello(&self) -> Result<Hello, PeerError> {
        let begin = Instant::now();
        let read = |bytes: &mut [u8]| {
            let left = HELLO_WITHIN.saturating_sub(begin.elapsed());
            match self.read(bytes, left) {
                Ok(true) => Ok(()),
                // A peer that sends something else and closes is no LUNA sender either.
                Ok(false) => Err(PeerError::NotLuna),
                Err(error) if error.kind() == ErrorKind::TimedOut => Err(PeerError::Silent),
                Err(_) => Err(PeerError::Damaged("it was cut off")),
            }
        };
        let mut hello = vec![0; HELLO];
        read(&mut hello[..MAGIC.len()])?;
        if hello[..MAGIC.len()] != MAGIC {
            return Err(PeerError::NotLuna);
        }
        read(&mut hello[MAGIC.len()..PREFIX])?;
        check_prefix(&hello)?;
        read(&mut hello[PREFIX..])?;
        let rest = Hello::rest(&hello)?;
        hello.resize(HELLO.saturating_add(rest), 0);
        read(&mut hello[HELLO..])?;
        Hello::read(&hello)
    }

    /// Takes blocks until the sender goes.
    fn blocks(&self, visit: u64, known: &Mutex<Known>) -> io::Result<()> {
        let damaged = |what| io::Error::other(PeerError::Damaged(what));
        let next: Answer = Ok(lock(known).next);
        self.write(&answer_bytes(next))?;
        let mut block = vec![0; BLOCK_START];
        loop {
            block.resize(BLOCK_START, 0);
            if !self.read(&mut block, SILENT)? {
                return Ok(());
            }
            let (number, length) = (u32_at(&block, 4), u32_at(&block, 8) as usize);
            if block[..4] != BLOCK_MAGIC || length > MAX_IN_BLOCK {
                return Err(damaged("it is no block"));
            }
            block.resize(BLOCK_START.saturating_add(length), 0);
            if !self.read(&mut block[BLOCK_START..], SILENT)? {
                let what = "it ends in a block";
                return Err(io::Error::new(ErrorKind::UnexpectedEof, what));
            }
            if checksum(&block) != u32_at(&block, 12) {
                return Err(damaged("a block's checksum is wrong"));
            }
            let mut known = lock(known);
            if !known.is_of(visit) {
                return Err(io::Error::other("it has come again by another connection"));
            }
            if number != known.next {
                return Err(damaged("a block is not the next one"));
            }
            known.block(&mut block)?;
            known.next = known.next.wrapping_add(1);
            let next = known.next;
            drop(known);
            self.write(&ack_bytes(next))?;
        }
    }

    /// Reads all; false if the peer has gone before the first byte.
    fn read(&self, bytes: &mut [u8], within: Duration) -> io::Result<bool> {
        timed::read(&self.stream, bytes, within, || self.office.is_over())?.ok_or_else(stopped)
    }

    fn write(&self, bytes: &[u8]) -> io::Result<()> {
        timed::write(&self.stream, bytes, ACK_WITHIN, || self.office.is_over())?.ok_or_else(stopped)
    }
}

fn stopped() -> io::Error {
    io::Error::other("the recorder was stopped")
}
