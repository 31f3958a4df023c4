//! The protocol over a socket.

use super::data::{CycleData, TypeIdentity};
use super::datagram::MAX_DATAGRAM;
use super::error::CycleError;
use super::protocol::{Moment, Protocol, Received};
use super::sample::{Converted, Sample};
use super::settings::Settings;
use super::socket::{Sent, check_addresses, hand_over, is_refusal, moment, new_session};
use super::status::Status;
use luna::Instant;
use luna::time::{Conversion, LeaderTick, StampClock, StampSource};
use luna_machine::socket;
use luna_platform::clock::Clock;
use std::future::{Future, poll_fn};
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};
use std::pin::pin;
use std::task::Poll;
use std::time::Duration;

/// The most datagrams that are received in one go.
const IN_ONE_GO: u32 = 64;

/// After a look that found nothing, so many calls wait without one: a system call less.
const WITHOUT_LOOK: u32 = 16;

/// How often the state of the clock is read, if its stamps are TAI.
const CLOCK_STATE_EVERY: Duration = Duration::from_secs(1);

/// A link to one other computer: one datagram with a value each way in each cycle.
///
/// A process, or a thread, has it and uses it directly: [`send`](Self::send) and
/// [`newest`](Self::newest) in a periodic loop, [`recv`](Self::recv) in a process that follows the
/// partner. With channels on the near side it is a process of its own:
/// [`process`](Self::process).
///
/// The example of the [module](super) has both sides.
pub struct CycleLink<O, I> {
    socket: UdpSocket,
    peer: SocketAddr,
    pub(super) protocol: Protocol<O, I>,
    /// The protocol's.
    status: Status,
    source: StampSource,
    conversion: Conversion,
    clock_read: Option<Instant>,
    has_timeout: bool,
    /// How many calls of `recv` are to wait at once, without looking first.
    without_look: u32,
    buffer: Box<[u8; MAX_DATAGRAM + 1]>,
}

impl<O: CycleData, I: CycleData> CycleLink<O, I> {
    /// Opens a link from `local`, an address of this computer, to `peer`. Nothing is waited for:
    /// the partner may be started later.
    ///
    /// Not for the real-time path.
    ///
    /// # Errors
    ///
    /// [`CycleError`]: an address that is none of one computer, or the system's error.
    pub fn open(
        local: SocketAddr,
        peer: SocketAddr,
        settings: &Settings,
    ) -> Result<Self, CycleError> {
        check_addresses(local, peer)?;
        let bound = UdpSocket::bind(local);
        let socket = bound.map_err(|source| CycleError::Socket {
            peer,
            what: "bind its address",
            source,
        })?;
        Self::over(socket, peer, settings)
    }

    /// As [`open`](Self::open), with a socket that is bound already: to a free port, say, or with
    /// options of your own. It is put in blocking mode.
    ///
    /// # Errors
    ///
    /// As there.
    pub fn over(
        socket: UdpSocket,
        peer: SocketAddr,
        settings: &Settings,
    ) -> Result<Self, CycleError> {
        let failed = |what| move |source| CycleError::Socket { peer, what, source };
        let local = socket.local_addr().map_err(failed("ask for its address"))?;
        check_addresses(local, peer)?;
        let connected = socket.connect(peer);
        connected.map_err(failed("connect it to the partner's address"))?;
        let mode = socket.set_nonblocking(false);
        mode.map_err(failed("set its mode"))?;
        let mut buffer = Box::new([0; MAX_DATAGRAM + 1]);
        // What came before the connection may be anyone's.
        for _ in 0..4096 {
            match socket::receive_now(&socket, &mut buffer[..]) {
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                _ => {}
            }
        }
        let source = settings.stamps;
        let protocol = Protocol::new(new_session(), settings, moment(source));
        Ok(Self {
            status: protocol.status(),
            protocol,
            socket,
            peer,
            source,
            conversion: source.conversion(),
            clock_read: None,
            has_timeout: false,
            without_look: 0,
            buffer,
        })
    }

    /// Sends a value without waiting.
    ///
    /// Real-time path: a system call, two after a refusal; it never waits, and allocates nothing.
    /// With stamps of TAI one more in each second.
    ///
    /// # Errors
    ///
    /// [`CycleError`]: the system refuses the datagram for good, or the clock is a virtual one.
    pub fn send(&mut self, value: &O) -> Result<Sent, CycleError> {
        self.send_at(value, None)
    }

    /// As [`send`](Self::send), and says in which slot of the sender's loop
    /// ([`Cycle::deadline`](luna::time::Cycle)): the partner's loop can
    /// [follow](luna::time::Follower) it.
    ///
    /// # Errors
    ///
    /// As there.
    pub fn send_in_slot(&mut self, value: &O, slot: Instant) -> Result<Sent, CycleError> {
        self.send_at(value, Some(slot))
    }

    fn send_at(&mut self, value: &O, slot: Option<Instant>) -> Result<Sent, CycleError> {
        let now = self.begin()?;
        let tick = slot.map(|slot| self.conversion.stamp(slot));
        let bytes = self.protocol.send(value, tick, now);
        let sent = hand_over(&self.socket, bytes, &self.status);
        sent.map_err(|source| CycleError::Socket {
            peer: self.peer,
            what: "send a datagram",
            source,
        })
    }

    /// The newest value that has come since the last one, without waiting; those before it are
    /// dropped. None if nothing new has come, and the partner is not silent for too long.
    ///
    /// Real-time path: a system call for each datagram and one more, for 64 datagrams at most.
    ///
    /// # Errors
    ///
    /// [`CycleError::Stale`]: no value for longer than the settings allow; the link can be used on.
    /// Others as for [`send`](Self::send).
    pub fn newest(&mut self) -> Result<Option<Sample<I>>, CycleError> {
        let mut newest: Option<Sample<I>> = None;
        for _ in 0..IN_ONE_GO {
            let now = self.begin()?;
            match self.take(now)? {
                Taken::Sample(mut sample) => {
                    if let Some(older) = &newest {
                        sample.skipped = older.skipped + 1;
                        sample.lost_before += older.lost_before;
                    }
                    newest = Some(sample);
                }
                Taken::Other => {}
                Taken::Empty => break,
            }
        }
        match newest {
            Some(sample) => Ok(Some(sample)),
            None => self.unless_stale().map(|()| None),
        }
    }

    /// Waits for the next value.
    ///
    /// Works on executors and in OS-thread processes. Cancel-safe: nothing that came is dropped.
    /// Real-time path: yes, but for the first wait of a thread
    /// ([`prepare_files`](luna::external::prepare_files)); three or four system calls a value.
    ///
    /// # Errors
    ///
    /// [`CycleError::Stale`]: none came until the limit after the last one, or where that has
    /// passed already, after the call. The link can be used on. Others as for [`send`](Self::send).
    pub async fn recv(&mut self) -> Result<Sample<I>, CycleError> {
        let deadline = self.deadline()?;
        if self.without_look > 0 {
            self.without_look -= 1;
            self.readable(deadline).await?;
        }
        let mut calls = 0;
        loop {
            calls += 1;
            if calls % IN_ONE_GO == 0 {
                luna::yield_now().await;
            }
            let now = self.begin()?;
            match self.take(now)? {
                Taken::Sample(sample) => return Ok(sample),
                Taken::Other if now.instant < deadline => {}
                Taken::Empty if now.instant < deadline => {
                    self.without_look = WITHOUT_LOOK;
                    self.readable(deadline).await?;
                }
                _ => self.unless_stale()?,
            }
        }
    }

    /// Waits for the next value by sleeping in the kernel: a system call less to wait, and no
    /// executor in between. For plain threads, and for OS-thread processes that do nothing else: on
    /// an executor it stops all processes, and a process that is to be cancelled ends when it
    /// returns.
    ///
    /// # Errors
    ///
    /// As for [`recv`](Self::recv). The kernel rounds the limit up to its tick.
    pub fn blocking_recv(&mut self) -> Result<Sample<I>, CycleError> {
        let deadline = self.deadline()?;
        if !self.has_timeout {
            let limit = self.protocol.limit().max(Duration::from_micros(1));
            let set = self.socket.set_read_timeout(Some(limit));
            set.map_err(self.failed("set its time limit"))?;
            self.has_timeout = true;
        }
        loop {
            let came = socket::receive(&self.socket, &mut self.buffer[..]);
            let now = self.begin()?;
            match self.understand(came, now)? {
                Taken::Sample(sample) => return Ok(sample),
                _ if now.instant < deadline => {}
                _ => self.unless_stale()?,
            }
        }
    }

    /// The slot of the partner's loop in which it sent the sample, for a
    /// [`Follower`](luna::time::Follower), if it said so.
    pub fn tick_of(&self, sample: &Sample<I>) -> Option<LeaderTick> {
        let Converted { at, error } = sample.tick?;
        Some(LeaderTick {
            at: self.conversion.instant(at),
            error: error + self.conversion.error(),
        })
    }

    /// Counters, and the offset of the partner's clock. It can be read from any thread.
    pub fn status(&self) -> Status {
        self.status.clone()
    }

    /// Its own address, with the actual port.
    ///
    /// # Errors
    ///
    /// The system's error.
    pub fn local_address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// The partner's address.
    pub fn peer(&self) -> SocketAddr {
        self.peer
    }

    /// Until when a value is waited for.
    fn deadline(&mut self) -> Result<Instant, CycleError> {
        let now = self.begin()?.instant;
        let deadline = self.protocol.deadline();
        Ok(match deadline > now {
            true => deadline,
            false => now + self.protocol.limit(),
        })
    }

    pub(super) fn unless_stale(&mut self) -> Result<(), CycleError> {
        let Some(silence) = self.protocol.silence(luna::now()) else {
            return Ok(());
        };
        let here = TypeIdentity::of::<I>();
        let there = self.status.other_type();
        Err(CycleError::Stale {
            peer: self.peer,
            silence,
            other_type: there.map(|there| (here, there)),
        })
    }

    /// Waits until there may be a datagram, until `deadline` at most.
    pub(super) async fn readable(&self, deadline: Instant) -> Result<(), CycleError> {
        let mut ready = pin!(luna::external::readable(&self.socket));
        let mut late = pin!(luna::at(deadline));
        let waited = poll_fn(|cx| match ready.as_mut().poll(cx) {
            Poll::Ready(waited) => Poll::Ready(waited),
            Poll::Pending => late.as_mut().poll(cx).map(Ok),
        });
        waited.await.map_err(|source| CycleError::Wait {
            peer: self.peer,
            source,
        })
    }

    /// Takes the next datagram, if there is one.
    pub(super) fn take(&mut self, now: Moment) -> Result<Taken<I>, CycleError> {
        let came = socket::receive_now(&self.socket, &mut self.buffer[..]);
        self.understand(came, now)
    }

    fn understand(&mut self, came: io::Result<usize>, now: Moment) -> Result<Taken<I>, CycleError> {
        match came {
            Ok(length) => Ok(match self.protocol.receive(&self.buffer[..length], now) {
                Received::Sample(sample) => Taken::Sample(sample),
                Received::Answer => {
                    let hello = self.protocol.hello(moment(self.source));
                    // A hello that is lost is sent again when the partner is next heard.
                    let _ = socket::send_now(&self.socket, hello);
                    Taken::Other
                }
                Received::Nothing => Taken::Other,
            }),
            Err(error) if is_refusal(&error) => {
                self.status.count(|counters| &counters.refused);
                Ok(Taken::Other)
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                Ok(Taken::Empty)
            }
            Err(source) => Err(self.failed("receive a datagram")(source)),
        }
    }

    /// The present moment, on a clock that goes with the partner's.
    pub(super) fn begin(&mut self) -> Result<Moment, CycleError> {
        if Clock::is_virtual_here() {
            return Err(CycleError::VirtualClock { peer: self.peer });
        }
        let now = moment(self.source);
        if self.source.clock() == StampClock::Tai {
            let is_due = |read| now.instant - read >= CLOCK_STATE_EVERY;
            if self.clock_read.is_none_or(is_due) {
                self.clock_read = Some(now.instant);
                self.conversion = self.source.conversion();
                // Without a daemon nothing is claimed.
                let state = self.source.state().ok();
                let error = state.and_then(|state| state.error());
                self.protocol.set_clock_error(error);
            }
        }
        Ok(now)
    }

    fn failed(&self, what: &'static str) -> impl FnOnce(io::Error) -> CycleError + use<O, I> {
        let peer = self.peer;
        move |source| CycleError::Socket { peer, what, source }
    }
}

/// What was done with the next datagram.
pub(super) enum Taken<I> {
    Sample(Sample<I>),
    /// Something else came.
    Other,
    /// Nothing is there.
    Empty,
}

luna_platform::debug_fields!(
    impl[O, I] CycleLink<O, I>, |link|
    peer: link.peer,
    stamps: link.source.clock()
);
