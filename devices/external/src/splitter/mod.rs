//! Bytes in, records out.

use crate::error::LinkError;
use crate::framing::{Framing, Kind, Prefix};
use crate::record::{BadRecord, Fault};
use std::ops::Range;

/// Reads of less than this cost more by the call than by the byte.
const READ_AHEAD: usize = 4096;

/// Divides what is read into records: for links of your own, to whatever gives bytes. It allocates
/// when it is made, and then no more; all else of it is for the real-time path.
///
/// ```
/// use luna::external::{Framing, Splitter};
///
/// let mut splitter = Splitter::new(Framing::lines(80))?;
/// let read = b"one\ntw"; // as much as came
/// splitter.room()[..read.len()].copy_from_slice(read);
/// splitter.filled(read.len());
/// assert_eq!(splitter.next_record(), Some(Ok(&b"one"[..])));
/// assert_eq!(splitter.next_record(), None); // the rest is still to come
/// # Ok::<(), luna::external::LinkError>(())
/// ```
///
/// # Invariants
///
/// `start <= end <= buffer.len()`. When [`next_record`](Self::next_record) has given nothing, what
/// is held is shorter than a whole record, so there is room for the rest of it.
#[derive(Debug)]
pub struct Splitter {
    framing: Framing,
    buffer: Box<[u8]>,
    /// The held bytes lie from here to `end`.
    start: usize,
    end: usize,
    /// How many of the bytes held are known to be no delimiter.
    searched: usize,
    skip: Skip,
    number: u64,
}

/// The bytes to discard of a record that was too long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Skip {
    Nothing,
    ToDelimiter,
    Bytes(u64),
}

/// Where a record lies, or what is wrong with it.
type Found = Result<Range<usize>, Fault>;

impl Splitter {
    /// One for this framing.
    ///
    /// # Errors
    ///
    /// [`LinkError::Room`] or [`LinkError::PrefixTooSmall`].
    pub fn new(framing: Framing) -> Result<Self, LinkError> {
        framing.validate()?;
        let most = framing.most;
        let size = match framing.kind {
            Kind::Fixed => READ_AHEAD.max(most),
            // With a carriage return and the delimiter; with the prefix.
            Kind::Delimited { .. } => READ_AHEAD.max(most + 2),
            Kind::Prefixed(prefix) => READ_AHEAD.max(most + prefix.size()),
            Kind::Chunks => most,
            // So that a packet that is too long shows: the system cuts it off without a word.
            Kind::Packets => most + 1,
        };
        Ok(Self {
            framing,
            buffer: vec![0; size].into_boxed_slice(),
            start: 0,
            end: 0,
            searched: 0,
            skip: Skip::Nothing,
            number: 0,
        })
    }

    /// Holds nothing any more, and counts from 1 again: for another connection.
    ///
    /// ```
    /// use luna::external::{Framing, Splitter};
    ///
    /// let mut splitter = Splitter::new(Framing::fixed(2))?;
    /// splitter.room()[0] = b'a';
    /// splitter.filled(1);
    /// splitter.clear();
    /// assert_eq!(splitter.finish(), None);
    /// # Ok::<(), luna::external::LinkError>(())
    /// ```
    pub fn clear(&mut self) {
        (self.start, self.end, self.searched, self.number) = (0, 0, 0, 0);
        self.skip = Skip::Nothing;
    }

    /// Where to read to. Never empty after [`next_record`](Self::next_record) has given nothing.
    /// Moves less than a record.
    pub fn room(&mut self) -> &mut [u8] {
        if self.start > 0 {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
        }
        &mut self.buffer[self.end..]
    }

    /// So many bytes were read to the front of the [`room`](Self::room).
    ///
    /// # Panics
    ///
    /// If there was not so much room.
    pub fn filled(&mut self, count: usize) {
        assert!(count <= self.buffer.len() - self.end);
        self.end += count;
    }

    /// The next whole record that is held, or what is wrong with it. O(its bytes), and O(bytes
    /// held) to skip.
    pub fn next_record(&mut self) -> Option<Result<&[u8], BadRecord>> {
        let found = match self.framing.kind {
            Kind::Fixed => self.find_fixed(),
            Kind::Delimited {
                delimiter, of_text, ..
            } => self.find_delimited(delimiter, of_text),
            Kind::Prefixed(prefix) => self.find_prefixed(prefix),
            Kind::Chunks | Kind::Packets => self.find_whole(),
        };
        found.map(|found| self.report(found))
    }

    /// What the end of the file leaves of a record. Called when [`next_record`](Self::next_record)
    /// has given nothing.
    ///
    /// ```
    /// use luna::external::{Fault, Framing, Splitter};
    ///
    /// let mut splitter = Splitter::new(Framing::fixed(2))?;
    /// splitter.room()[0] = b'a';
    /// splitter.filled(1);
    /// assert_eq!(splitter.finish().unwrap().unwrap_err().fault, Fault::Cut { came: 1 });
    /// # Ok::<(), luna::external::LinkError>(())
    /// ```
    pub fn finish(&mut self) -> Option<Result<&[u8], BadRecord>> {
        let held = std::mem::replace(&mut self.start, self.end)..self.end;
        // The skipped bytes were reported before.
        if held.is_empty() || self.skip != Skip::Nothing {
            return None;
        }
        let found = match self.framing.kind {
            // A carriage return that nothing follows is the text's own; what it makes too long is.
            Kind::Delimited { open_end: true, .. } if held.len() <= self.framing.most => Ok(held),
            Kind::Delimited { open_end: true, .. } => Err(self.too_long()),
            _ => Err(Fault::Cut { came: held.len() }),
        };
        Some(self.report(found))
    }

    fn report(&mut self, found: Found) -> Result<&[u8], BadRecord> {
        self.number += 1;
        match found {
            Ok(place) => Ok(&self.buffer[place]),
            Err(fault) => Err(self.bad(fault)),
        }
    }

    /// The record given last, as a bad one: with its number.
    pub fn bad(&self, fault: Fault) -> BadRecord {
        BadRecord {
            number: self.number,
            fault,
        }
    }

    fn too_long(&self) -> Fault {
        Fault::TooLong {
            most: self.framing.most,
        }
    }

    fn held(&self) -> &[u8] {
        &self.buffer[self.start..self.end]
    }

    fn find_fixed(&mut self) -> Option<Found> {
        let size = self.framing.most;
        (self.held().len() >= size).then(|| {
            let place = self.start..self.start + size;
            self.start = place.end;
            Ok(place)
        })
    }

    fn find_delimited(&mut self, delimiter: u8, of_text: bool) -> Option<Found> {
        loop {
            let at = self.held()[self.searched..]
                .iter()
                .position(|byte| *byte == delimiter)
                .map(|at| self.start + self.searched + at);
            match at {
                Some(at) => {
                    let mut place = self.start..at;
                    self.start = at + 1;
                    self.searched = 0;
                    if self.skip == Skip::ToDelimiter {
                        self.skip = Skip::Nothing;
                        continue;
                    }
                    if of_text && self.buffer[place.clone()].ends_with(b"\r") {
                        place.end -= 1;
                    }
                    return Some(if place.len() > self.framing.most {
                        Err(self.too_long())
                    } else {
                        Ok(place)
                    });
                }
                None if self.skip == Skip::ToDelimiter => {
                    self.start = self.end;
                    return None;
                }
                None => {
                    self.searched = self.held().len();
                    if self.searched <= self.framing.most + usize::from(of_text) {
                        return None;
                    }
                    self.start = self.end;
                    self.searched = 0;
                    self.skip = Skip::ToDelimiter;
                    return Some(Err(self.too_long()));
                }
            }
        }
    }

    fn find_prefixed(&mut self, prefix: Prefix) -> Option<Found> {
        if let Skip::Bytes(left) = self.skip {
            let skipped = left.min(self.held().len() as u64);
            self.start += skipped as usize;
            if skipped < left {
                self.skip = Skip::Bytes(left - skipped);
                return None;
            }
            self.skip = Skip::Nothing;
        }
        let length = prefix.read(self.held())?;
        let begin = self.start + prefix.size();
        if length > self.framing.most as u64 {
            self.start = begin;
            self.skip = Skip::Bytes(length);
            return Some(Err(self.too_long()));
        }
        let place = begin..begin + length as usize;
        (place.end <= self.end).then(|| {
            self.start = place.end;
            Ok(place)
        })
    }

    fn find_whole(&mut self) -> Option<Found> {
        let place = std::mem::replace(&mut self.start, self.end)..self.end;
        match place.len() {
            0 => None,
            length if length > self.framing.most => Some(Err(self.too_long())),
            _ => Some(Ok(place)),
        }
    }
}

#[cfg(test)]
mod tests;
