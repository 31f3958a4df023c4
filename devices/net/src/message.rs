//! What crosses the network.
//!
//! A message is [`MAGIC`], then [`Head`] and [`Body`] in postcard's format. Behind [`Body::Values`]
//! come the values, each as: when it was sent, in 8 bytes; its length, in 4; its bytes. The CRC-32
//! of all that is the last 4 bytes: a damaged message cannot be taken for another one.

use crate::Role;
use luna::channel::ChannelEnd;
use serde::{Deserialize, Serialize};

/// Begins every message. Its last digit counts the versions of the protocol.
pub(crate) const MAGIC: [u8; 8] = *b"lunanet4";
/// How much of it is the same in all versions.
const COMMON: usize = MAGIC.len() - 1;

/// Sender and receiver of a message: by numbers that each opening of a side draws at random.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Head {
    pub(crate) from: u64,
    /// 0: to any that hears it.
    pub(crate) to: u64,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Body {
    /// Until the session is joined.
    Hello(Hello),
    /// From time to time, and to acknowledge.
    Beat(Beat),
    /// The first of them has this number; the others follow.
    Values { first: u64 },
    /// The sender of this has ended the session, or has heard that the other one has. The former is
    /// to be answered by the latter.
    End { is_poisoned: bool, is_answer: bool },
    /// This side has a partner that lives.
    Busy { pid: u32, host: String },
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Hello {
    pub(crate) type_name: String,
    pub(crate) type_version: u32,
    pub(crate) pid: u32,
    pub(crate) host: String,
    /// Equal where CLOCK_MONOTONIC is common.
    pub(crate) clock: u64,
    /// Number of the last value that was sent or taken in earlier sessions.
    pub(crate) last: u64,
    /// Number of the last session.
    pub(crate) session: u64,
    /// How many values may be under way from or to this side.
    pub(crate) window: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Beat {
    /// Of the receiver: number of the last value that was taken.
    pub(crate) taken: u64,
    /// Of the receiver: number of the last value that has arrived.
    pub(crate) arrived: u64,
    /// The clock there, as this was sent.
    pub(crate) sent: u64,
    /// The least difference there between arrival and sending of messages.
    pub(crate) seen: Option<i64>,
}

/// A whole message. `behind` adds what comes behind the body.
pub(crate) fn encode(head: Head, body: &Body, behind: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let bytes = MAGIC.to_vec();
    // A vector takes whatever comes, and these types have no error of their own.
    let mut bytes = postcard::to_extend(&(head, body), bytes).unwrap_or_default();
    behind(&mut bytes);
    let checksum = crc32fast::hash(&bytes);
    bytes.extend_from_slice(&checksum.to_le_bytes());
    bytes
}

/// Why bytes are no message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Broken {
    /// They were not sent so, or not by this protocol.
    Damaged,
    /// They begin as those of another version of the protocol.
    OtherVersion,
}

/// The message, and what is behind it.
pub(crate) fn decode(bytes: &[u8]) -> Result<(Head, Body, &[u8]), Broken> {
    let Some(_) = bytes.strip_prefix(&MAGIC) else {
        return Err(match bytes.starts_with(&MAGIC[..COMMON]) {
            true => Broken::OtherVersion,
            false => Broken::Damaged,
        });
    };
    let (whole, checksum) = bytes.split_last_chunk().ok_or(Broken::Damaged)?;
    if crc32fast::hash(whole) != u32::from_le_bytes(*checksum) {
        return Err(Broken::Damaged);
    }
    let rest = whole.get(MAGIC.len()..).ok_or(Broken::Damaged)?;
    let ((head, body), values) = postcard::take_from_bytes(rest).map_err(|_| Broken::Damaged)?;
    Ok((head, body, values))
}

/// Bytes in front of a value.
pub(crate) const VALUE_HEAD: usize = 12;

/// What is in front of a value.
pub(crate) fn put_value_head(head: &mut [u8; VALUE_HEAD], sent: u64, length: usize) {
    head[..8].copy_from_slice(&sent.to_le_bytes());
    // No buffer for messages is so large that this cuts anything off.
    head[8..].copy_from_slice(&(length as u32).to_le_bytes());
}

/// The next value: when it was sent, and its bytes; none if it is cut off.
pub(crate) fn next_value<'a>(rest: &mut &'a [u8]) -> Option<(u64, &'a [u8])> {
    let (sent, behind) = rest.split_first_chunk()?;
    let (length, behind) = behind.split_first_chunk()?;
    let length = u32::from_le_bytes(*length);
    let (value, behind) = behind.split_at_checked(usize::try_from(length).ok()?)?;
    *rest = behind;
    Some((u64::from_le_bytes(*sent), value))
}

pub(crate) fn end_of(is_poisoned: bool) -> ChannelEnd {
    match is_poisoned {
        true => ChannelEnd::Poisoned,
        false => ChannelEnd::Closed,
    }
}

/// Where a side publishes.
pub(crate) fn key(name: &str, role: Role) -> String {
    format!("luna/{name}/from-{}", role.word())
}

/// The token of a living side. With `*` as its number it stands for all of the role.
pub(crate) fn token(name: &str, role: Role, number: Option<u64>) -> String {
    let number = number.map_or("*".to_owned(), |number| format!("{number:x}"));
    format!("luna/{name}/alive/{}/{number}", role.word())
}

/// Of which opening a token is.
pub(crate) fn of_token(key: &str) -> Option<u64> {
    u64::from_str_radix(key.rsplit('/').next()?, 16).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_come_back() {
        let head = Head { from: 7, to: 0 };
        let body = Body::Values { first: 3 };
        let message = encode(head, &body, |message| {
            for (sent, value) in [(11, b"one".as_slice()), (12, b"")] {
                let mut head = [0; VALUE_HEAD];
                put_value_head(&mut head, sent, value.len());
                message.extend([&head, value].concat());
            }
        });
        let (got, found, mut rest) = decode(&message).unwrap();
        assert_eq!((got, found), (head, body));
        assert_eq!(next_value(&mut rest), Some((11, b"one".as_slice())));
        assert_eq!(next_value(&mut rest), Some((12, b"".as_slice())));
        assert!(rest.is_empty());
    }

    #[test]
    fn garbage_is_no_message() {
        assert_eq!(decode(b""), Err(Broken::Damaged));
        assert_eq!(decode(b"lunanet0abc"), Err(Broken::OtherVersion));
        assert_eq!(decode(b"lunanet4\xff\xff"), Err(Broken::Damaged));
        // With its checksum, and no message.
        let mut bytes = b"lunanet4\xff\xff".to_vec();
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        assert_eq!(decode(&bytes), Err(Broken::Damaged));
        // A length beyond the end.
        assert_eq!(
            next_value(&mut [1, 0, 0, 0, 0, 0, 0, 0, 9, 0, 0, 0, 5].as_slice()),
            None
        );
    }

    #[test]
    fn no_damage_makes_another_message() {
        let hello = Hello {
            type_name: "u64".to_owned(),
            type_version: 0,
            pid: 1,
            host: "here".to_owned(),
            clock: 1,
            last: 0,
            session: 0,
            window: 64,
        };
        let head = Head { from: 7, to: 9 };
        let busy = Body::Busy {
            pid: 1,
            host: "there".to_owned(),
        };
        let end = Body::End {
            is_poisoned: true,
            is_answer: false,
        };
        for body in [Body::Hello(hello), Body::Values { first: 3 }, end, busy] {
            let message = encode(head, &body, |_| ());
            assert!(decode(&message).is_ok());
            for place in 0..message.len() {
                assert!(
                    decode(&message[..place]).is_err(),
                    "{body:?} cut at {place}"
                );
                let mut damaged = message.clone();
                for change in 1..=255 {
                    damaged[place] = message[place] ^ change;
                    assert!(decode(&damaged).is_err(), "{body:?} at {place}");
                }
            }
        }
    }

    #[test]
    fn tokens_say_of_which_opening_they_are() {
        let token = token("cell/ready", Role::Sender, Some(0xab12));
        assert_eq!(token, "luna/cell/ready/alive/sender/ab12");
        assert_eq!(of_token(&token), Some(0xab12));
        assert_eq!(of_token("luna/cell/ready/alive/sender/*"), None);
    }
}
