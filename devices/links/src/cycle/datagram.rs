//! The bytes of a datagram: a head of fixed layout, and the value behind it.
//!
//! All numbers are little-endian.
//!
//! | bytes | field | meaning |
//! | --- | --- | --- |
//! | 0–3 | magic | `LUNc` |
//! | 4 | protocol | 1 |
//! | 5 | kind | 1: with a value; 2: a hello, without one |
//! | 6 | clock | of the sender's stamps: 0 CLOCK_MONOTONIC, 1 CLOCK_TAI |
//! | 7 | – | 0 |
//! | 8–15 | from | the sender's session: a random number that is not 0 |
//! | 16–23 | to | the session that the sender has heard from; 0: none |
//! | 24–31 | type name | hash of the name |
//! | 32–35 | size | of the value |
//! | 36–39 | version | of the value's layout |
//! | 40–47 | number | of the datagram, from 1 |
//! | 48–55 | sequence | of the value: counts what was to be sent, from 1. In a hello, of the last value |
//! | 56–63 | sent | stamp just before sending |
//! | 64–71 | clock error | of the sender's clock to TAI in ns; all ones: unknown |
//! | 72–79 | echo number | of the newest datagram that has come from `to`; 0: none |
//! | 80–87 | echo sent | its stamp `sent`, on the receiver's clock |
//! | 88–95 | echo received | when it came, on the sender's clock |
//! | 96–103 | tick | the slot of the sender's loop on its clock; all ones: none |
//! | 104– | value | `size` bytes; nothing in a hello |

use super::data::TypeIdentity;
use luna::time::{Stamp, StampClock};

/// Of the head.
pub(crate) const HEAD: usize = 104;

/// The longest value: one datagram is one frame on Ethernet, under IPv6 too.
pub const MAX_SIZE: usize = 1452 - HEAD;

/// Of the longest datagram.
pub(crate) const MAX_DATAGRAM: usize = HEAD + MAX_SIZE;

const MAGIC: [u8; 4] = *b"LUNc";
const PROTOCOL: u8 = 1;
const NONE: u64 = u64::MAX;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Value,
    Hello,
}

/// The newest datagram that was received from the other side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Echo {
    pub(crate) number: u64,
    pub(crate) sent: Stamp,
    pub(crate) received: Stamp,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Head {
    pub(crate) kind: Kind,
    pub(crate) clock: StampClock,
    pub(crate) from: u64,
    pub(crate) to: u64,
    pub(crate) of: TypeIdentity,
    pub(crate) number: u64,
    pub(crate) sequence: u64,
    pub(crate) sent: Stamp,
    pub(crate) clock_error: Option<u64>,
    pub(crate) echo: Option<Echo>,
    pub(crate) tick: Option<Stamp>,
}

impl Head {
    /// Writes it to the first bytes of `to`.
    pub(crate) fn encode(&self, to: &mut [u8; MAX_DATAGRAM]) {
        to[..4].copy_from_slice(&MAGIC);
        to[4] = PROTOCOL;
        to[5] = match self.kind {
            Kind::Value => 1,
            Kind::Hello => 2,
        };
        to[6] = match self.clock {
            StampClock::Monotonic => 0,
            StampClock::Tai => 1,
        };
        to[7] = 0;
        let mut put = |at: usize, number: u64| {
            to[at..at + 8].copy_from_slice(&number.to_le_bytes());
        };
        let echo = self.echo.unwrap_or(Echo {
            number: 0,
            sent: Stamp::default(),
            received: Stamp::default(),
        });
        put(8, self.from);
        put(16, self.to);
        put(24, self.of.name_hash);
        put(
            32,
            u64::from(self.of.version) << 32 | u64::from(self.of.size),
        );
        put(40, self.number);
        put(48, self.sequence);
        put(56, self.sent.as_nanos());
        put(64, self.clock_error.unwrap_or(NONE));
        put(72, echo.number);
        put(80, echo.sent.as_nanos());
        put(88, echo.received.as_nanos());
        put(96, self.tick.map_or(NONE, Stamp::as_nanos));
    }

    /// The head and the value's bytes, if these are a datagram of this protocol. They may be any
    /// bytes.
    pub(crate) fn decode(bytes: &[u8]) -> Option<(Head, &[u8])> {
        let (head, value) = bytes.split_at_checked(HEAD)?;
        if head[..4] != MAGIC || head[4] != PROTOCOL || head[7] != 0 {
            return None;
        }
        let number = |at: usize| {
            let mut bytes = [0; 8];
            bytes.copy_from_slice(&head[at..at + 8]);
            u64::from_le_bytes(bytes)
        };
        let kind = match head[5] {
            1 => Kind::Value,
            2 => Kind::Hello,
            _ => return None,
        };
        let clock = match head[6] {
            0 => StampClock::Monotonic,
            1 => StampClock::Tai,
            _ => return None,
        };
        let (version, size) = ((number(32) >> 32) as u32, number(32) as u32);
        let unless = |none: u64, at: usize| Some(number(at)).filter(|there| *there != none);
        let head = Head {
            kind,
            clock,
            from: unless(0, 8)?,
            to: number(16),
            of: TypeIdentity::stated(number(24), size, version),
            number: unless(0, 40)?,
            sequence: number(48),
            sent: Stamp::from_nanos(number(56)),
            clock_error: unless(NONE, 64),
            echo: unless(0, 72).map(|of| Echo {
                number: of,
                sent: Stamp::from_nanos(number(80)),
                received: Stamp::from_nanos(number(88)),
            }),
            tick: unless(NONE, 96).map(Stamp::from_nanos),
        };
        let expected = match kind {
            Kind::Value => size as usize,
            Kind::Hello => 0,
        };
        let counts = kind == Kind::Hello || head.sequence > 0;
        (counts && value.len() == expected).then_some((head, value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn heads() -> impl Strategy<Value = Head> {
        let numbers = prop::array::uniform12(1..u64::MAX);
        (numbers, any::<[bool; 3]>(), 0..MAX_SIZE as u32).prop_map(|(numbers, choices, size)| {
            let [
                from,
                to,
                name,
                number,
                sequence,
                sent,
                error,
                of,
                echoed,
                received,
                tick,
                version,
            ] = numbers;
            Head {
                kind: if choices[0] { Kind::Value } else { Kind::Hello },
                clock: if choices[1] {
                    StampClock::Tai
                } else {
                    StampClock::Monotonic
                },
                from,
                to,
                of: TypeIdentity::stated(name, size, version as u32),
                number,
                sequence,
                sent: Stamp::from_nanos(sent),
                clock_error: choices[2].then_some(error),
                echo: choices[1].then_some(Echo {
                    number: of,
                    sent: Stamp::from_nanos(echoed),
                    received: Stamp::from_nanos(received),
                }),
                tick: choices[0].then_some(Stamp::from_nanos(tick)),
            }
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn what_is_encoded_is_decoded(head in heads()) {
            let mut bytes = [0xa5; MAX_DATAGRAM];
            head.encode(&mut bytes);
            let length = HEAD + match head.kind {
                Kind::Value => head.of.size as usize,
                Kind::Hello => 0,
            };
            let (decoded, value) = Head::decode(&bytes[..length]).unwrap();
            prop_assert_eq!(decoded, head);
            prop_assert!(value.iter().all(|byte| *byte == 0xa5));
            prop_assert!(Head::decode(&bytes[..length - 1]).is_none());
        }

        /// Whole heads with a few bytes changed reach further than random ones.
        #[test]
        fn no_bytes_make_it_panic(
            head in heads(),
            changes in prop::collection::vec((0..HEAD, any::<u8>()), 0..8),
            length in 0..MAX_DATAGRAM,
            noise in prop::collection::vec(any::<u8>(), 0..2 * HEAD),
        ) {
            let mut bytes = [0; MAX_DATAGRAM];
            head.encode(&mut bytes);
            for (at, byte) in changes {
                bytes[at] = byte;
            }
            let _ = Head::decode(&bytes[..length]);
            let _ = Head::decode(&noise);
        }
    }
}
