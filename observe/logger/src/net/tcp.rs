//! The sending side over TCP.

use super::timed;
use super::wire::{
    ACK, ANSWER, Hello, Key, MAGIC, PREFIX, PeerError, check_prefix, now, read_ack, read_answer,
};
use crate::format::{Encoder, Tally, seal};
use crate::monitor::Monitor;
use crate::recorder::{Sink, TCP};
use crate::thread::start;
use std::collections::{HashSet, VecDeque};
use std::io::{self, ErrorKind, Write};
use std::net::{Shutdown, TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The limit of the bytes of waiting blocks.
const ROOM: usize = 4 << 20;
/// The limit of blocks sent before acknowledgements are read. The socket buffers the
/// acknowledgements of these.
const MAX_AHEAD: usize = 256;
/// Limits for a connection attempt, and for a piece of data that does not get on.
const CONNECT: Duration = Duration::from_secs(1);
const STANDS: Duration = Duration::from_secs(2);
/// Pauses between attempts: doubled each time, until the receiver has acknowledged something.
const BACK_OFF: (Duration, Duration) = (Duration::from_millis(50), Duration::from_secs(5));
/// Pause after the receiver reported that it has no room. It is longer than the time for which the
/// receiver refuses.
const NO_ROOM: Duration = Duration::from_secs(30);

/// Sends a recording to a [`Receiver`](crate::Receiver) over TCP, on a thread of its own. Blocks
/// wait in at most 4 MiB until the receiver has acknowledged them, and the recorder never waits for
/// the network. When the buffer is full, blocks are refused.
///
/// A connection that fails, or does not get on for two seconds, is made again. The pause is 50 ms
/// at first and doubles up to 5 s, until the receiver acknowledges something. It is 30 s if the
/// receiver reported that it has no room, unless the recording is ending.
///
/// The receiver reports what it has, so nothing is sent twice. A receiver that does not know the
/// recording (it was restarted) begins a new file: waiting blocks are lost, since they could not be
/// read without the declarations before them, and everything is declared again. A peer that is no
/// recorder of LUNA, or one of another version, is reported on standard error, once, and tried
/// again.
///
/// Usually made by [`Logging::to_tcp`](crate::Logging::to_tcp); use it directly in a
/// [`Tee`](crate::Tee).
///
/// ```no_run
/// use luna_logger::{FileSink, Logging, TcpSink, Tee};
/// let both =
///     Tee::new(FileSink::create("run.luna".as_ref())?).and(TcpSink::new("recorder.lan:7411"));
/// let recording = Logging::to_sink(both);
/// # drop(recording);
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct TcpSink {
    address: String,
    shared: Arc<Shared>,
    system: String,
}

type Shared = Monitor<State>;

#[derive(Debug, Default)]
struct State {
    /// Blocks that were not acknowledged, first to last.
    blocks: VecDeque<Arc<Vec<u8>>>,
    bytes: usize,
    /// The number of the first of them.
    first: u32,
    /// Everything is to be declared before another block is taken.
    begins_anew: bool,
    wants_declarations: bool,
    lost: Tally,
    part: u32,
    is_ending: bool,
    is_left_alone: bool,
    is_gone: bool,
    error: Option<String>,
}

impl State {
    fn next(&self) -> u32 {
        self.first.wrapping_add(self.blocks.len() as u32)
    }

    /// The receiver has all blocks before `next`. Returns whether that is progress, or none if the
    /// number is impossible.
    fn acknowledge(&mut self, next: u32) -> Option<bool> {
        let acknowledged = next.wrapping_sub(self.first) as usize;
        if acknowledged > self.blocks.len() {
            return None;
        }
        let gone: usize = self
            .blocks
            .drain(..acknowledged)
            .map(|block| block.len())
            .sum();
        self.bytes -= gone;
        self.first = next;
        Some(acknowledged > 0)
    }

    fn lose_all(&mut self) {
        for block in self.blocks.drain(..) {
            self.lost.add(&block);
        }
        self.bytes = 0;
    }

    /// For a receiver that does not know the earlier blocks.
    fn begin_again(&mut self) {
        self.lose_all();
        self.first = 0;
        self.part = self.part.wrapping_add(1);
        self.begins_anew = true;
        self.wants_declarations = true;
    }
}

impl TcpSink {
    /// Creates a sink for `address`, `HOST:PORT`. It does not connect yet.
    pub fn new(address: impl Into<String>) -> Self {
        Self {
            address: address.into(),
            shared: Arc::default(),
            system: String::new(),
        }
    }
}

impl Sink for TcpSink {
    fn place(&self) -> String {
        format!("{TCP}{}", self.address)
    }

    fn begin(&mut self, _head: &[u8]) -> io::Result<()> {
        check_address(&self.address)?;
        let mut link = Link {
            address: self.address.clone(),
            shared: self.shared.clone(),
            key: Key::new(),
            started: now(),
            system: self.system.clone(),
            said: HashSet::new(),
        };
        start("luna-record-tcp", move || link.run()).map(drop)
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        let mut state = self.shared.lock();
        if state.begins_anew && !Encoder::is_session(block) {
            return Err(io::Error::other(
                "the recorder was restarted: everything is declared again",
            ));
        }
        if state.bytes + block.len() > ROOM {
            let why = state.error.as_deref().unwrap_or("it is too slow");
            return Err(io::Error::other(format!(
                "4 MiB wait for the recorder: {why}"
            )));
        }
        state.begins_anew = false;
        let mut block = block.to_vec();
        seal(&mut block, state.next());
        state.bytes += block.len();
        state.blocks.push_back(Arc::new(block));
        drop(state);
        self.shared.wake();
        Ok(())
    }

    fn is_of(&mut self, system: &str) {
        system.clone_into(&mut self.system);
    }

    fn wants_declarations(&mut self) -> bool {
        std::mem::take(&mut self.shared.lock().wants_declarations)
    }

    fn take_lost(&mut self) -> Tally {
        std::mem::take(&mut self.shared.lock().lost)
    }

    fn end(&mut self, limit: Duration) -> io::Result<()> {
        let begin = Instant::now();
        let mut state = self.shared.lock();
        state.is_ending = true;
        self.shared.wake();
        while !state.is_gone {
            let left = limit.saturating_sub(begin.elapsed());
            if left.is_zero() {
                break;
            }
            state = self.shared.wait(state, left);
        }
        state.is_left_alone = true;
        self.shared.wake();
        if state.blocks.is_empty() {
            return Ok(());
        }
        state.lose_all();
        let why = state.error.as_deref().unwrap_or("it is too slow");
        Err(io::Error::other(format!(
            "the recorder has not acknowledged the last blocks: {why}"
        )))
    }
}

impl Drop for TcpSink {
    fn drop(&mut self) {
        self.shared.change(|state| state.is_left_alone = true);
    }
}

/// Checks the form `HOST:PORT`, not whether the host exists.
pub(super) fn check_address(address: &str) -> io::Result<()> {
    let is_good = address.rsplit_once(':').is_some_and(|(host, port)| {
        !host.is_empty() && port.parse::<u16>().is_ok_and(|port| port != 0)
    });
    match is_good {
        true => Ok(()),
        false => Err(io::Error::new(
            ErrorKind::InvalidInput,
            "it is no address HOST:PORT",
        )),
    }
}

/// The thread that sends.
struct Link {
    address: String,
    shared: Arc<Shared>,
    key: Key,
    started: i64,
    system: String,
    said: HashSet<PeerError>,
}

/// Why a connection is over.
#[derive(Debug)]
enum Over {
    /// All was sent and the recording has ended, or the thread is detached.
    Done,
    Broken(io::Error),
}

impl From<io::Error> for Over {
    fn from(error: io::Error) -> Self {
        Over::Broken(error)
    }
}

impl From<PeerError> for Over {
    fn from(error: PeerError) -> Self {
        Over::Broken(io::Error::other(error))
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.shared.change(|state| state.is_gone = true);
    }
}

impl Link {
    fn run(&mut self) {
        let mut back_off = BACK_OFF.0;
        loop {
            let for_room = match self.connection(&mut back_off) {
                Over::Done => return,
                Over::Broken(error) => self.note(&error),
            };
            let begin = Instant::now();
            let mut state = self.shared.lock();
            loop {
                // The thread that waits for the end has a limit of its own.
                if state.is_left_alone || state.is_ending && state.blocks.is_empty() {
                    return;
                }
                // At the end do not wait for room: this may be the last attempt.
                let pause = for_room.filter(|_| !state.is_ending).unwrap_or(back_off);
                let left = pause.saturating_sub(begin.elapsed());
                if left.is_zero() {
                    break;
                }
                state = self.shared.wait(state, left);
            }
            back_off = (2 * back_off).min(BACK_OFF.1);
        }
    }

    /// Keeps the error, and reports it if a user has to act. Returns the pause if the receiver has
    /// no room.
    fn note(&mut self, error: &io::Error) -> Option<Duration> {
        let text = format!("{TCP}{}: {error}", self.address);
        let peer = error
            .get_ref()
            .and_then(|inner| inner.downcast_ref::<PeerError>());
        if let Some(peer) = peer
            && self.said.insert(*peer)
        {
            // Standard error may be closed.
            let _ = writeln!(io::stderr().lock(), "luna: recording to {text}");
        }
        self.shared.lock().error = Some(text);
        (peer == Some(&PeerError::NoRoom)).then_some(NO_ROOM)
    }

    /// Connects, and sends until an error. The next pause is short again only if the receiver made
    /// progress: a receiver that accepts connections but takes no blocks (its disk is full) is not
    /// asked again at once for ever.
    fn connection(&mut self, pause: &mut Duration) -> Over {
        let outcome = self.connect().and_then(|stream| {
            self.greet(&stream, pause)?;
            self.shared.lock().error = None;
            self.send(&stream, pause)
        });
        outcome.err().unwrap_or(Over::Done)
    }

    fn connect(&self) -> Result<TcpStream, Over> {
        let mut last = io::Error::new(ErrorKind::NotFound, "the host has no address");
        for address in self.address.to_socket_addrs()? {
            if self.is_left_alone() {
                return Err(Over::Done);
            }
            match TcpStream::connect_timeout(&address, CONNECT) {
                Ok(stream) => {
                    stream.set_nodelay(true)?;
                    return Ok(stream);
                }
                Err(error) => last = error,
            }
        }
        Err(last.into())
    }

    /// Sends the hello, and reads how much the recorder has.
    fn greet(&self, stream: &TcpStream, pause: &mut Duration) -> Result<(), Over> {
        let hello = {
            let state = self.shared.lock();
            Hello {
                key: Key {
                    part: state.part,
                    ..self.key
                },
                next: state.first,
                started: self.started,
                process: std::process::id(),
                system: self.system.clone(),
            }
        };
        self.write(stream, &hello.bytes())?;
        let mut answer = [0; ANSWER];
        // Another program may send less, and then wait.
        self.read(stream, &mut answer[..MAGIC.len()])?;
        if answer[..MAGIC.len()] != MAGIC {
            return Err(PeerError::NotLuna.into());
        }
        self.read(stream, &mut answer[MAGIC.len()..PREFIX])?;
        check_prefix(&answer)?;
        self.read(stream, &mut answer[PREFIX..])?;
        let next = read_answer(&answer)?;
        let mut state = self.shared.lock();
        let Some(is_on) = state.acknowledge(next) else {
            // It does not know the recording, or knows another one.
            state.begin_again();
            // The next hello starts a new part.
            let what = "the recorder was started again";
            return Err(io::Error::new(ErrorKind::ConnectionReset, what).into());
        };
        if is_on {
            *pause = BACK_OFF.0;
        }
        Ok(())
    }

    /// Sends all blocks, and waits for more.
    fn send(&self, stream: &TcpStream, pause: &mut Duration) -> Result<(), Over> {
        loop {
            // The lock is not held while waiting for the network.
            let ahead: Vec<Arc<Vec<u8>>> = {
                let mut state = self.shared.lock();
                loop {
                    if state.is_left_alone || state.is_ending && state.blocks.is_empty() {
                        let _ = stream.shutdown(Shutdown::Write);
                        return Err(Over::Done);
                    }
                    if !state.blocks.is_empty() {
                        break state.blocks.iter().take(MAX_AHEAD).cloned().collect();
                    }
                    state = self.shared.wait(state, Duration::from_secs(60));
                }
            };
            for block in &ahead {
                self.write(stream, block)?;
            }
            for _ in &ahead {
                let mut ack = [0; ACK];
                self.read(stream, &mut ack)?;
                match self.shared.lock().acknowledge(read_ack(&ack)?) {
                    Some(true) => *pause = BACK_OFF.0,
                    Some(false) => {}
                    None => {
                        return Err(PeerError::Damaged("it acknowledges what was not sent").into());
                    }
                }
            }
        }
    }

    /// Writes all bytes within the limit for a stalled connection.
    fn write(&self, stream: &TcpStream, bytes: &[u8]) -> Result<(), Over> {
        timed::write(stream, bytes, STANDS, || self.is_left_alone())?.ok_or(Over::Done)
    }

    /// Fills `bytes` within the limit for a stalled connection.
    fn read(&self, stream: &TcpStream, bytes: &mut [u8]) -> Result<(), Over> {
        match timed::read(stream, bytes, STANDS, || self.is_left_alone())? {
            Some(true) => Ok(()),
            Some(false) => Err(io::Error::from(ErrorKind::UnexpectedEof).into()),
            None => Err(Over::Done),
        }
    }

    fn is_left_alone(&self) -> bool {
        self.shared.lock().is_left_alone
    }
}

#[cfg(test)]
mod tests;
