//! How an event is written.
//!
//! A byte with its kind and two flags (it is of the process itself, and follows the branch log's
//! last event), then what the flags leave open: the path of the branch, by how many operations it
//! is later. Then what belongs to the kind. Numbers are varints.

use arrayvec::ArrayVec;
use luna_core::replay_log::{self, About, What};

/// What is written at the most before the bytes of an input or output.
pub(super) const LONGEST_HEAD: usize = 64;

const OF_PROCESS: u8 = 1 << 7;
const NEXT: u8 = 1 << 6;
const CALL: u8 = 1 << 5;

/// What an event is about.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Kind {
    Outcome(replay_log::Event),
    Bytes {
        about: About,
        name: u32,
        bytes: Vec<u8>,
    },
    /// The process has returned.
    Ended,
    /// It was ended; whether in the middle of an operation. If not, a call means that the branch
    /// log may have gone on after its last operation.
    Cut(bool),
}

/// An event of a branch_log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Event {
    pub(super) path: u32,
    /// The number of the branch_log's operation.
    pub(super) operation: u64,
    /// The operation does not wait.
    pub(super) is_call: bool,
    pub(super) kind: Kind,
}

impl Event {
    /// Its bytes, if it is about this and has this name.
    pub(super) fn bytes_of(&self, about: About, name: u32) -> Option<&[u8]> {
        match &self.kind {
            Kind::Bytes {
                about: of,
                name: named,
                bytes,
            } if (*of, *named) == (about, name) => Some(bytes),
            _ => None,
        }
    }
}

/// An event's head on its way to a ring.
pub(super) struct Head(ArrayVec<u8, LONGEST_HEAD>);

impl Head {
    /// Of an event of the branch_log at `path`, `later` operations after the last one there.
    pub(super) fn new(code: u8, is_call: bool, path: u32, later: u64) -> Self {
        let mut head = Self(ArrayVec::new());
        head.0.push(code | if is_call { CALL } else { 0 });
        if path == 0 {
            head.0[0] |= OF_PROCESS;
        } else {
            head.number(u64::from(path));
        }
        if later == 1 {
            head.0[0] |= NEXT;
        } else {
            head.number(later);
        }
        head
    }

    pub(super) fn number(&mut self, mut number: u64) {
        loop {
            let is_last = number < 0x80;
            self.0
                .push(number as u8 & 0x7f | if is_last { 0 } else { 0x80 });
            number >>= 7;
            if is_last {
                return;
            }
        }
    }

    pub(super) fn get(&self) -> &[u8] {
        &self.0
    }
}

/// What bytes may be about: the codes up to 4 are those of outcomes.
const ABOUTS: [About; 4] = [About::Input, About::Output, About::Cycle, About::Read];
pub(super) const ENDED: u8 = 8;
pub(super) const CUT: u8 = 9;
pub(super) const CUT_WITHIN: u8 = 10;

/// A difference as a number that is small if it is.
pub(super) fn zigzag(from: u64, to: u64) -> u64 {
    let difference = to.wrapping_sub(from) as i64;
    (difference << 1 ^ difference >> 63) as u64
}

/// What [`zigzag`] was made of.
pub(super) fn unzigzag(from: u64, difference: u64) -> u64 {
    from.wrapping_add(difference >> 1 ^ (difference & 1).wrapping_neg())
}

/// Reads events off a process' bytes.
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    last_time: u64,
    branch_logs: std::collections::HashMap<u32, u64>,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self {
            bytes,
            last_time: 0,
            branch_logs: std::collections::HashMap::new(),
        }
    }

    /// How many bytes are left.
    pub(super) fn left(&self) -> usize {
        self.bytes.len()
    }

    /// The next event. `None`: what is left is none, or not the whole of one.
    pub(super) fn next(&mut self) -> Option<Event> {
        let before = self.bytes;
        let event = self.read();
        if event.is_none() {
            self.bytes = before;
        }
        event
    }

    fn byte(&mut self) -> Option<u8> {
        let (&byte, rest) = self.bytes.split_first()?;
        self.bytes = rest;
        Some(byte)
    }

    fn number(&mut self) -> Option<u64> {
        let mut number = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            let part = u64::from(byte & 0x7f);
            // A byte more than needed, or bits that fall off, are no number.
            if shift == 63 && part > 1 || shift > 0 && byte == 0 {
                return None;
            }
            number |= part << shift;
            if byte & 0x80 == 0 {
                return Some(number);
            }
        }
        None
    }

    fn read(&mut self) -> Option<Event> {
        let first = self.byte()?;
        let path = match first & OF_PROCESS {
            0 => u32::try_from(self.number()?)
                .ok()
                .filter(|&path| path != 0)?,
            _ => 0,
        };
        let later = match first & NEXT {
            0 => self.number().filter(|&later| later != 1)?,
            _ => 1,
        };
        let operation = self
            .branch_logs
            .get(&path)
            .copied()
            .unwrap_or_default()
            .checked_add(later)?;
        let outcome =
            |what, number, stamp| Kind::Outcome(replay_log::Event::new(what, number, stamp));
        let kind = match first & !(OF_PROCESS | NEXT | CALL) {
            0 => outcome(What::Done, 0, self.number()?),
            1 => outcome(What::Failed, self.number()?, 0),
            2 => outcome(What::TimedOut, 0, 0),
            3 => outcome(What::Chosen, self.number()?, self.number()?),
            4 => {
                let difference = self.number()?;
                self.last_time = unzigzag(self.last_time, difference);
                outcome(What::Time, self.last_time, 0)
            }
            ENDED => Kind::Ended,
            CUT => Kind::Cut(false),
            CUT_WITHIN => Kind::Cut(true),
            code => {
                let about = ABOUTS.into_iter().find(|about| *about as u8 == code)?;
                let name = u32::try_from(self.number()?).ok()?;
                let length = usize::try_from(self.number()?).ok()?;
                let (bytes, rest) = self.bytes.split_at_checked(length)?;
                self.bytes = rest;
                Kind::Bytes {
                    about,
                    name,
                    bytes: bytes.to_vec(),
                }
            }
        };
        self.branch_logs.insert(path, operation);
        Some(Event {
            path,
            operation,
            is_call: first & CALL != 0,
            kind,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_come_back() {
        for (from, to) in [
            (0, 0),
            (5, 3),
            (3, 5),
            (0, u64::MAX),
            (u64::MAX, 0),
            (1 << 63, 7),
        ] {
            assert_eq!(unzigzag(from, zigzag(from, to)), to);
        }
        assert!(zigzag(1000, 999) < 3);
    }

    #[test]
    fn an_event_is_read_as_it_was_written_and_no_part_of_it_is_one() {
        let mut head = Head::new(What::Chosen as u8, false, 77, 300);
        head.number(2);
        head.number(1 << 40);
        let mut reader = Reader::new(head.get());
        let event = reader.next().unwrap();
        let kind = Kind::Outcome(replay_log::Event::new(What::Chosen, 2, 1 << 40));
        assert_eq!((event.path, event.operation), (77, 300));
        assert_eq!(event.kind, kind);
        assert_eq!(reader.next(), None);
        for length in 0..head.get().len() {
            assert_eq!(Reader::new(&head.get()[..length]).next(), None);
        }
    }

    #[test]
    fn any_bytes_are_read_without_a_panic() {
        let mut state = 7_u32;
        for _ in 0..2000 {
            let bytes: Vec<u8> = (0..40)
                .map(|_| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (state >> 24) as u8
                })
                .collect();
            let mut reader = Reader::new(&bytes);
            while reader.next().is_some() {}
        }
    }
}
