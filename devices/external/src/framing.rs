//! How records lie in a file's bytes.

use super::error::LinkError;

/// The most bytes that a record may be allowed to have: a greater number is a slip.
const LONGEST: usize = 1 << 30;

/// How a file's bytes are divided into records. Its bounds, in bytes, set how much a link allocates
/// in its `pre_run`.
///
/// ```
/// use luna::external::{Framing, Prefix};
///
/// let of_a_sensor = Framing::fixed(12);
/// let of_a_console = Framing::lines(80);
/// let of_a_radio = Framing::prefixed(Prefix::U16Big, 1500);
/// # let _ = (of_a_sensor, of_a_console, of_a_radio);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Framing {
    pub(super) kind: Kind,
    /// The most bytes of a record, without what frames it.
    pub(super) most: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Kind {
    Fixed,
    Delimited {
        delimiter: u8,
        /// A carriage return before the delimiter is part of it.
        of_text: bool,
        /// What follows the last delimiter is a record too.
        open_end: bool,
    },
    Prefixed(Prefix),
    Chunks,
    Packets,
}

/// How a record's length is written before it. It counts the bytes that follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Prefix {
    /// One byte.
    U8,
    /// Two bytes, the more significant first.
    U16Big,
    /// Two bytes, the less significant first.
    U16Little,
    /// Four bytes, the most significant first.
    U32Big,
    /// Four bytes, the least significant first.
    U32Little,
}

impl Kind {
    const fn delimited(delimiter: u8, of_text: bool) -> Self {
        Kind::Delimited {
            delimiter,
            of_text,
            open_end: false,
        }
    }
}

impl Framing {
    const fn of(kind: Kind, most: usize) -> Self {
        Self { kind, most }
    }

    /// Records of `size` bytes each.
    pub const fn fixed(size: usize) -> Framing {
        Self::of(Kind::Fixed, size)
    }

    /// Lines of text of at most `most` bytes, without their end: a line feed, when read also a
    /// carriage return before it.
    pub const fn lines(most: usize) -> Framing {
        Self::of(Kind::delimited(b'\n', true), most)
    }

    /// Records of at most `most` bytes that each end with the byte `delimiter`, which is no part of
    /// them.
    pub const fn delimited(delimiter: u8, most: usize) -> Framing {
        Self::of(Kind::delimited(delimiter, false), most)
    }

    /// Records of at most `most` bytes, each after its length.
    pub const fn prefixed(prefix: Prefix, most: usize) -> Framing {
        Self::of(Kind::Prefixed(prefix), most)
    }

    /// Bytes as they arrive, up to `most` at once: the boundaries mean nothing.
    pub const fn chunks(most: usize) -> Framing {
        Self::of(Kind::Chunks, most)
    }

    /// One record for each packet of a device or socket that keeps them apart, of at most `most`
    /// bytes. An empty packet is the end of the file: the system reports both alike.
    pub const fn packets(most: usize) -> Framing {
        Self::of(Kind::Packets, most)
    }

    /// Makes a record of what follows the last delimiter, too, if it has any bytes: for text with a
    /// last line that may lack its end. Without this it is reported as cut off. Framings without a
    /// delimiter stay as they are.
    #[must_use]
    pub const fn or_end_of_file(mut self) -> Framing {
        if let Kind::Delimited { open_end, .. } = &mut self.kind {
            *open_end = true;
        }
        self
    }

    pub(super) fn validate(self) -> Result<(), LinkError> {
        if self.most == 0 || self.most > LONGEST {
            return Err(LinkError::Room { most: self.most });
        }
        match self.kind {
            Kind::Prefixed(prefix) if self.most as u64 > prefix.longest() => {
                Err(LinkError::PrefixTooSmall {
                    most: self.most,
                    longest: prefix.longest(),
                })
            }
            _ => Ok(()),
        }
    }
}

impl Prefix {
    /// How many bytes it has.
    pub(super) const fn size(self) -> usize {
        match self {
            Prefix::U8 => 1,
            Prefix::U16Big | Prefix::U16Little => 2,
            Prefix::U32Big | Prefix::U32Little => 4,
        }
    }

    /// The greatest length that it can hold.
    const fn longest(self) -> u64 {
        (1 << (8 * self.size())) - 1
    }

    /// The length at the front of `bytes`, if all of it is there.
    pub(super) fn read(self, bytes: &[u8]) -> Option<u64> {
        let bytes = bytes.get(..self.size())?;
        let join = |value: u64, byte: &u8| value << 8 | u64::from(*byte);
        Some(match self {
            Prefix::U8 | Prefix::U16Big | Prefix::U32Big => bytes.iter().fold(0, join),
            Prefix::U16Little | Prefix::U32Little => bytes.iter().rev().fold(0, join),
        })
    }

    /// Writes `length`, which must fit, to the front of `to`.
    pub(super) fn write(self, length: usize, to: &mut [u8]) {
        let bytes = (length as u64).to_le_bytes();
        let to = &mut to[..self.size()];
        to.copy_from_slice(&bytes[..self.size()]);
        if matches!(self, Prefix::U16Big | Prefix::U32Big) {
            to.reverse();
        }
    }
}
