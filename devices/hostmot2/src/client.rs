//! Blocking exchanges with a card, for set-up.

use crate::description::{Board, Description};
use crate::idrom::{self, Idrom, IdromError};
use crate::lbp16::{Packet, PacketError, Reader, Space, Width};
use crate::registers::{self, board, scratch};
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// How many elements of the IDROM are read at a time.
const CHUNK: u8 = 64;

/// Exchanges packets with a card and waits for the answers: for set-up and tools. Not for the
/// real-time path.
///
/// ```no_run
/// use hostmot2::{Client, Layout, Selection};
///
/// let mut client = Client::connect("192.168.1.121:27181".parse()?)?;
/// let description = client.describe()?;
/// println!("{description}");
/// let layout = Layout::new(
///     &description,
///     &Selection {
///         encoders: 2,
///         pwms: 2,
///         ..Selection::default()
///     },
/// )?;
/// for packet in layout.set_up()? {
///     client.confirmed(&packet)?;
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Client {
    socket: UdpSocket,
    sequence: u32,
    timeout: Duration,
    attempts: u32,
}

/// Why an exchange failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ClientError {
    /// The socket cannot be had or used.
    #[error("no socket to the card: {0}")]
    Socket(#[source] io::Error),
    /// The card did not answer.
    #[error("the card at {card} did not answer {attempts} times: {}", reason(.last))]
    Silent {
        /// Which.
        card: SocketAddr,
        /// The number of attempts.
        attempts: u32,
        /// The system's last error, if it refused to send or receive.
        #[source]
        last: Option<io::Error>,
    },
    /// The device that answers is not a HostMot2 card: it has another cookie.
    #[error("the device that answers is no HostMot2: its cookie is {cookie:#010x}")]
    NotHostMot2 {
        /// Its cookie.
        cookie: u32,
    },
    /// The card's description cannot be read.
    #[error("{0}")]
    Idrom(#[source] IdromError),
    /// The packet would be too long.
    #[error("{0}")]
    Packet(#[from] PacketError),
}

/// Why there was no answer.
fn reason(last: &Option<io::Error>) -> String {
    match last {
        Some(error) => error.to_string(),
        None => "is it powered, and is this host in its network?".to_owned(),
    }
}

impl Client {
    /// Makes a socket to `card`. Asks it nothing yet.
    ///
    /// # Errors
    ///
    /// [`ClientError::Socket`].
    pub fn connect(card: SocketAddr) -> Result<Self, ClientError> {
        let from: SocketAddr = match card {
            SocketAddr::V4(_) => ([0, 0, 0, 0], 0).into(),
            SocketAddr::V6(_) => ([0_u16; 8], 0).into(),
        };
        let connect = || {
            let socket = UdpSocket::bind(from)?;
            socket.connect(card)?;
            Ok(socket)
        };
        // Different from the numbers of earlier clients.
        let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        let sequence = since.map_or(1, |since| since.as_nanos() as u32);
        Ok(Self {
            socket: connect().map_err(ClientError::Socket)?,
            sequence,
            timeout: Duration::from_millis(100),
            attempts: 5,
        })
    }

    /// Waits `timeout` for each answer, with at most `attempts` attempts; default 100 ms and 5.
    #[must_use]
    pub fn patience(mut self, timeout: Duration, attempts: u32) -> Self {
        self.timeout = timeout.max(Duration::from_millis(1));
        self.attempts = attempts.max(1);
        self
    }

    /// The number of the last request. The next ones' follow it.
    pub fn sequence(&self) -> u32 {
        self.sequence
    }

    /// The socket, to continue without the client.
    pub fn into_socket(self) -> UdpSocket {
        self.socket
    }

    /// Sends `packet` until the card confirms that it was executed, and returns what it read.
    ///
    /// The card may execute it several times, but not after later packets: answers to an earlier
    /// attempt are not accepted for a later packet.
    ///
    /// # Errors
    ///
    /// The card is silent, or the packet is too long with the number that is added to it.
    pub fn confirmed(&mut self, packet: &Packet) -> Result<Vec<u8>, ClientError> {
        let mut last = None;
        for _ in 0..self.attempts {
            self.sequence = self.sequence.wrapping_add(1);
            match self.attempt(packet) {
                Ok(Some(read)) => return Ok(read),
                Ok(None) => {}
                Err(ClientError::Socket(error)) => last = Some(error),
                Err(error) => return Err(error),
            }
        }
        Err(ClientError::Silent {
            card: self.socket.peer_addr().map_err(ClientError::Socket)?,
            attempts: self.attempts,
            last,
        })
    }

    /// Reads `count` elements from `address` on, at most 127.
    ///
    /// # Errors
    ///
    /// As [`confirmed`](Self::confirmed).
    pub fn read(
        &mut self,
        space: Space,
        width: Width,
        address: u16,
        count: u8,
    ) -> Result<Vec<u8>, ClientError> {
        let mut packet = Packet::new();
        packet.read(space, width, address, count)?;
        self.confirmed(&packet)
    }

    /// Reads the card's complete description.
    ///
    /// # Errors
    ///
    /// The card is silent, or is no HostMot2, or its description is invalid.
    pub fn describe(&mut self) -> Result<Description, ClientError> {
        let mut packet = Packet::new();
        packet.read(Space::HostMot2, Width::Bits32, registers::CONFIG_COOKIE, 4)?;
        packet.read(Space::Board, Width::Bits16, board::NAME, 8)?;
        packet.read(Space::Board, Width::Bits16, board::LBP16_VERSION, 3)?;
        let read = self.confirmed(&packet)?;
        let mut reader = Reader::new(&read);
        let cookie = reader.u32().unwrap_or_default();
        if cookie != registers::COOKIE {
            return Err(ClientError::NotHostMot2 { cookie });
        }
        let configuration = reader.take::<8>().unwrap_or_default();
        let offset = reader.u32().unwrap_or_default();
        let name = reader.take::<16>().unwrap_or_default();
        let mut version = || reader.u16().unwrap_or_default();
        let board = Board {
            name: idrom::text(&name),
            lbp16_version: version(),
            firmware_version: version(),
            jumpers: version(),
        };
        let mut idrom = Vec::with_capacity(idrom::SIZE);
        while idrom.len() < idrom::SIZE {
            let address = u32::try_from(idrom.len()).map(|done| offset.wrapping_add(done));
            let address = address.ok().and_then(|address| u16::try_from(address).ok());
            let address = address.ok_or(ClientError::Idrom(IdromError::Impossible {
                what: "place",
                value: offset,
            }))?;
            idrom.extend(self.read(Space::HostMot2, Width::Bits32, address, CHUNK)?);
        }
        Ok(Description {
            board,
            configuration: idrom::text(&configuration),
            idrom: Idrom::parse(&idrom).map_err(ClientError::Idrom)?,
        })
    }

    /// One attempt under the present number; nothing if no answer came.
    fn attempt(&mut self, packet: &Packet) -> Result<Option<Vec<u8>>, ClientError> {
        let mut numbered = Packet::new();
        let number = self.sequence.to_le_bytes();
        let (timers, wide) = (Space::Timers, Width::Bits16);
        numbered.write(timers, wide, scratch::READ_SEQUENCE, &number)?;
        numbered.read(timers, wide, scratch::READ_SEQUENCE, 2)?;
        let head = numbered.bytes().len();
        if head + packet.bytes().len() > crate::lbp16::MAX_PACKET {
            return Err(PacketError::Full.into());
        }
        let request = [numbered.bytes(), packet.bytes()].concat();
        self.socket.send(&request).map_err(ClientError::Socket)?;
        let expected = numbered.answer_len() + packet.answer_len();
        let deadline = Instant::now() + self.timeout;
        // One byte more than an answer has, to recognize longer datagrams, which are cut.
        let mut answer = vec![0; expected + 1];
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            let received = self
                .socket
                .set_read_timeout(Some(left))
                .and_then(|()| self.socket.recv(&mut answer));
            match received {
                Ok(length) if length == expected && answer.starts_with(&number) => {
                    return Ok(Some(answer[number.len()..expected].to_vec()));
                }
                // That of an earlier request.
                Ok(_) => {}
                Err(error) if is_timeout(&error) => {}
                Err(error) => {
                    // No program listens there yet: wait before the next attempt.
                    std::thread::sleep(left);
                    return Err(ClientError::Socket(error));
                }
            }
        }
    }
}

fn is_timeout(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), Interrupted | TimedOut | WouldBlock)
}
