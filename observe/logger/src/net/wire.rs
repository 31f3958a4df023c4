//! The messages between sender and receiver other than blocks. Numbers are little-endian;
//! `docs/recording-format.md` has the tables.
//!
//! The first 16 bytes of either side are the same in all versions, so that each side can name the
//! other's version.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use crate::format::{MAJOR, MINOR};
use std::hash::{BuildHasher, Hasher};

/// What both sides begin with.
pub(super) const MAGIC: [u8; 8] = *b"\x89LUNET\r\n";

/// The version of the protocol.
pub(super) const WIRE: (u16, u16) = (1, 0);

/// Bytes that are the same in all versions: magic, version of the protocol, version of the format.
pub(super) const PREFIX: usize = 16;

/// Bytes of a hello without its name and checksum.
pub(super) const HELLO: usize = 48;

/// Bytes of an answer.
pub(super) const ANSWER: usize = 28;

/// Bytes of an acknowledgement: `LACK`, and the number of the next expected block.
pub(super) const ACK: usize = 8;
const ACK_MAGIC: [u8; 4] = *b"LACK";

/// The most bytes of a system's name; the rest is cut off.
pub(super) const MAX_NAME: usize = 255;

/// Bytes in front of a datagram's block.
pub(super) const DATAGRAM: usize = 40;

/// Why a peer is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, thiserror::Error)]
#[non_exhaustive]
pub enum PeerError {
    /// Its first bytes are not those of a sender or recorder of LUNA.
    #[error("the peer is not LUNA's")]
    NotLuna,
    /// It speaks another major version.
    #[error("the peer speaks version {}.{}, and this program {}.x", .theirs.0, .theirs.1, WIRE.0)]
    Version {
        /// The major and minor version that it speaks.
        theirs: (u16, u16),
    },
    /// Its recordings have another major version.
    #[error("the peer's recordings have format version {}.{}, and this program's {MAJOR}.x", .theirs.0, .theirs.1)]
    Format {
        /// The major and minor version of them.
        theirs: (u16, u16),
    },
    /// The recorder has reached its limit of senders.
    #[error("the recorder has reached its limit of senders")]
    Full,
    /// The recorder takes no more from this sender: a limit, or a full disk.
    #[error("the recorder has no room for more")]
    NoRoom,
    /// Its data is damaged: what is wrong with it.
    #[error("the peer's data is damaged: {0}")]
    Damaged(&'static str),
    /// It did not answer in time.
    #[error("the peer did not answer in time")]
    Silent,
}

/// `N` bytes at `at`.
fn number<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut number = [0; N];
    if let Some(there) = bytes.get(at..).and_then(<[u8]>::first_chunk) {
        number = *there;
    }
    number
}

pub(super) fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(number(bytes, at))
}

pub(super) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(number(bytes, at))
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(number(bytes, at))
}

fn prefix() -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    for number in [WIRE.0, WIRE.1, MAJOR, MINOR] {
        bytes.extend(number.to_le_bytes());
    }
    bytes
}

/// Checks the common beginning of either side.
pub(super) fn check_prefix(bytes: &[u8]) -> Result<(), PeerError> {
    if bytes.len() < PREFIX || bytes[..8] != MAGIC {
        return Err(PeerError::NotLuna);
    }
    let wire = (u16_at(bytes, 8), u16_at(bytes, 10));
    let format = (u16_at(bytes, 12), u16_at(bytes, 14));
    if wire.0 != WIRE.0 {
        return Err(PeerError::Version { theirs: wire });
    }
    if format.0 != MAJOR {
        return Err(PeerError::Format { theirs: format });
    }
    Ok(())
}

fn end(mut bytes: Vec<u8>) -> Vec<u8> {
    let checksum = crc32fast::hash(&bytes);
    bytes.extend(checksum.to_le_bytes());
    bytes
}

fn check_end(bytes: &[u8], length: usize) -> Result<(), PeerError> {
    if bytes.len() < length.saturating_add(4)
        || crc32fast::hash(&bytes[..length]) != u32_at(bytes, length)
    {
        return Err(PeerError::Damaged("its checksum is wrong"));
    }
    Ok(())
}

/// Identifies a recording. When a recorder has forgotten the earlier parts, another part begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Key {
    pub(super) session: u64,
    pub(super) part: u32,
}

impl Key {
    /// A key that no other recording has.
    pub(super) fn new() -> Self {
        // The keys of a `RandomState` are random.
        let hasher = std::collections::hash_map::RandomState::new().build_hasher();
        Self {
            session: hasher.finish(),
            part: 0,
        }
    }
}

/// The identity of a sender.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Hello {
    pub(super) key: Key,
    /// The number of the first block that it still has.
    pub(super) next: u32,
    /// Nanoseconds since 1970.
    pub(super) started: i64,
    pub(super) process: u32,
    pub(super) system: String,
}

impl Hello {
    pub(super) fn bytes(&self) -> Vec<u8> {
        let name = &self.system[..self.system.floor_char_boundary(MAX_NAME)];
        let mut bytes = prefix();
        bytes.extend(self.key.session.to_le_bytes());
        bytes.extend(self.key.part.to_le_bytes());
        bytes.extend(self.next.to_le_bytes());
        bytes.extend(self.started.to_le_bytes());
        bytes.extend(self.process.to_le_bytes());
        bytes.extend((name.len() as u16).to_le_bytes());
        bytes.extend([0, 0]);
        debug_assert_eq!(bytes.len(), HELLO);
        bytes.extend(name.as_bytes());
        end(bytes)
    }

    /// How many bytes follow the first [`HELLO`].
    pub(super) fn rest(fixed: &[u8]) -> Result<usize, PeerError> {
        check_prefix(fixed)?;
        let name = usize::from(u16_at(fixed, 44));
        if name > MAX_NAME {
            return Err(PeerError::Damaged("its name is too long"));
        }
        Ok(name + 4)
    }

    pub(super) fn read(bytes: &[u8]) -> Result<Self, PeerError> {
        let length = HELLO.saturating_add(Self::rest(bytes)?.saturating_sub(4));
        check_end(bytes, length)?;
        let name = std::str::from_utf8(&bytes[HELLO..length])
            .map_err(|_| PeerError::Damaged("its name is not UTF-8"))?;
        Ok(Self {
            key: Key {
                session: u64_at(bytes, 16),
                part: u32_at(bytes, 24),
            },
            next: u32_at(bytes, 28),
            started: u64_at(bytes, 32).cast_signed(),
            process: u32_at(bytes, 40),
            system: name.to_owned(),
        })
    }
}

/// A recorder's answer to a hello: the number of the block that it expects, or why it refuses.
pub(super) type Answer = Result<u32, PeerError>;

pub(super) fn answer_bytes(answer: Answer) -> Vec<u8> {
    let (verdict, next) = match answer {
        Ok(next) => (0, next),
        Err(PeerError::Full) => (2, 0),
        Err(PeerError::NoRoom) => (3, 0),
        // The sender sees this side's version in the answer.
        Err(PeerError::Version { .. } | PeerError::Format { .. }) => (1, 0),
        Err(_) => (4, 0),
    };
    let mut bytes = prefix();
    bytes.extend([verdict, 0, 0, 0]);
    bytes.extend(u32::to_le_bytes(next));
    end(bytes)
}

pub(super) fn read_answer(bytes: &[u8]) -> Answer {
    check_prefix(bytes)?;
    check_end(bytes, ANSWER - 4)?;
    match bytes[PREFIX] {
        0 => Ok(u32_at(bytes, 20)),
        1 => Err(PeerError::Version { theirs: WIRE }),
        2 => Err(PeerError::Full),
        3 => Err(PeerError::NoRoom),
        _ => Err(PeerError::Damaged("the recorder could not read it")),
    }
}

pub(super) fn ack_bytes(next: u32) -> [u8; ACK] {
    let mut bytes = [0; ACK];
    bytes[..4].copy_from_slice(&ACK_MAGIC);
    bytes[4..].copy_from_slice(&next.to_le_bytes());
    bytes
}

pub(super) fn read_ack(bytes: &[u8; ACK]) -> Result<u32, PeerError> {
    match bytes[..4] == ACK_MAGIC {
        true => Ok(u32_at(bytes, 4)),
        false => Err(PeerError::Damaged("an acknowledgement is malformed")),
    }
}

/// The header before a datagram's block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Datagram {
    pub(super) key: Key,
    pub(super) started: i64,
}

impl Datagram {
    pub(super) fn bytes(self) -> Vec<u8> {
        let mut bytes = prefix();
        bytes.extend(self.key.session.to_le_bytes());
        bytes.extend(self.key.part.to_le_bytes());
        bytes.extend(self.started.to_le_bytes());
        let bytes = end(bytes);
        debug_assert_eq!(bytes.len(), DATAGRAM);
        bytes
    }

    pub(super) fn read(bytes: &[u8]) -> Result<Self, PeerError> {
        check_prefix(bytes)?;
        check_end(bytes, DATAGRAM - 4)?;
        Ok(Self {
            key: Key {
                session: u64_at(bytes, 16),
                part: u32_at(bytes, 24),
            },
            started: u64_at(bytes, 28).cast_signed(),
        })
    }
}

/// Nanoseconds since 1970.
pub(super) fn now() -> i64 {
    std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .ok()
        .and_then(|since| i64::try_from(since.as_nanos()).ok())
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_bytes_are_those_of_the_documentation() {
        let hello = Hello {
            key: Key {
                session: 0x0807_0605_0403_0201,
                part: 9,
            },
            next: 10,
            started: -1,
            process: 11,
            system: "arm".to_owned(),
        };
        let mut expected = b"\x89LUNET\r\n\x01\0\0\0\x01\0\0\0".to_vec();
        expected.extend([1, 2, 3, 4, 5, 6, 7, 8, 9, 0, 0, 0, 10, 0, 0, 0]);
        expected.extend([255; 8]);
        expected.extend([11, 0, 0, 0, 3, 0, 0, 0]);
        expected.extend(b"arm");
        let bytes = hello.bytes();
        assert_eq!(bytes[..expected.len()], expected);
        assert_eq!(bytes.len(), expected.len() + 4);
        assert_eq!(ack_bytes(258), *b"LACK\x02\x01\0\0");
        assert_eq!(answer_bytes(Ok(258))[16..24], [0, 0, 0, 0, 2, 1, 0, 0]);
        assert_eq!(answer_bytes(Ok(1)).len(), ANSWER);
    }

    #[test]
    fn other_versions_are_reported_as_such() {
        let mut bytes = answer_bytes(Ok(0));
        bytes[8] = 7;
        assert_eq!(
            read_answer(&bytes),
            Err(PeerError::Version { theirs: (7, 0) })
        );
        let mut bytes = answer_bytes(Ok(0));
        bytes[12] = 7;
        assert_eq!(
            read_answer(&bytes),
            Err(PeerError::Format { theirs: (7, 0) })
        );
        assert_eq!(
            read_answer(b"HTTP/1.1 400 Bad Request\r\n...."),
            Err(PeerError::NotLuna)
        );
        for error in [PeerError::Full, PeerError::NoRoom] {
            assert_eq!(read_answer(&answer_bytes(Err(error))), Err(error));
        }
    }

    proptest! {
        #[test]
        fn messages_are_decoded_as_encoded(
            session: u64, part: u32, next: u32, started: i64, process: u32, system in ".{0,80}",
            at: prop::sample::Index, change in 1u8..=255,
        ) {
            let key = Key { session, part };
            let hello = Hello { key, next, started, process, system };
            let mut bytes = hello.bytes();
            prop_assert_eq!(Hello::read(&bytes), Ok(hello));
            for length in 0..bytes.len() {
                prop_assert!(Hello::read(&bytes[..length]).is_err());
            }
            let at = at.index(bytes.len());
            bytes[at] ^= change;
            prop_assert!(Hello::read(&bytes).is_err());
            let datagram = Datagram { key, started };
            prop_assert_eq!(Datagram::read(&datagram.bytes()), Ok(datagram));
        }

        #[test]
        fn anything_at_all_is_read_without_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            let started = [&prefix()[..], &bytes].concat();
            for bytes in [bytes, started] {
                let _ = (Hello::read(&bytes), read_answer(&bytes), Datagram::read(&bytes));
            }
        }
    }
}
