//! What crosses the network.
//!
//! A message is [`MAGIC`], then [`Head`] and [`Body`] in postcard's format. Behind [`Body::Values`]
//! come the values, each as: when it was sent, in 8 bytes; its length, in 4; its bytes.

use crate::Role;
use luna::channel::ChannelEnd;
use serde::{Deserialize, Serialize};

/// Begins every message. Its last digit counts the versions of the protocol.
pub(crate) const MAGIC: [u8; 8] = *b"lunanet3";

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

pub(crate) fn encode(head: Head, body: &Body) -> Vec<u8> {
    let bytes = MAGIC.to_vec();
    // A vector takes whatever comes, and these types have no error of their own.
    postcard::to_extend(&(head, body), bytes).unwrap_or_default()
}

/// The message, and what is behind it; none if it is of another version of the protocol.
pub(crate) fn decode(bytes: &[u8]) -> Option<(Head, Body, &[u8])> {
    let rest = bytes.strip_prefix(&MAGIC)?;
    let ((head, body), values) = postcard::take_from_bytes(rest).ok()?;
    Some((head, body, values))
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
        let mut message = encode(head, &body);
        for (sent, value) in [(11, b"one".as_slice()), (12, b"")] {
            let mut head = [0; VALUE_HEAD];
            put_value_head(&mut head, sent, value.len());
            message.extend([&head, value].concat());
        }
        let (got, found, mut rest) = decode(&message).unwrap();
        assert_eq!((got, found), (head, body));
        assert_eq!(next_value(&mut rest), Some((11, b"one".as_slice())));
        assert_eq!(next_value(&mut rest), Some((12, b"".as_slice())));
        assert!(rest.is_empty());
    }

    #[test]
    fn garbage_is_no_message() {
        assert!(decode(b"").is_none());
        assert!(decode(b"lunanet0abc").is_none());
        assert!(decode(b"lunanet3\xff\xff").is_none());
        // A length beyond the end.
        assert_eq!(
            next_value(&mut [1, 0, 0, 0, 0, 0, 0, 0, 9, 0, 0, 0, 5].as_slice()),
            None
        );
    }

    #[test]
    fn tokens_say_of_which_opening_they_are() {
        let token = token("cell/ready", Role::Sender, Some(0xab12));
        assert_eq!(token, "luna/cell/ready/alive/sender/ab12");
        assert_eq!(of_token(&token), Some(0xab12));
        assert_eq!(of_token("luna/cell/ready/alive/sender/*"), None);
    }
}
