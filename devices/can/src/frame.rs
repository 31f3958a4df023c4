//! Frames of classical CAN.

use embedded_can::{ExtendedId, Id, StandardId};
use std::cmp::Ordering;
use std::fmt;

/// A data or remote frame of classical CAN: an identifier of 11 or 29 bits, and up to 8 bytes.
///
/// It is plain data: 16 bytes, copied. It has the trait `Frame` of `embedded-can` too.
///
/// ```
/// use luna_can::Frame;
///
/// let frame = Frame::standard(0x123, &[1, 2, 3]).unwrap();
/// assert_eq!(frame.data(), [1, 2, 3]);
/// assert_eq!(frame.to_string(), "123 [3] 01 02 03");
/// assert!(Frame::standard(0x800, &[]).is_none());
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Frame {
    id: Id,
    is_remote: bool,
    len: u8,
    /// Zero from `len` on.
    data: [u8; 8],
}

impl Frame {
    /// A data frame; none if there are more than 8 bytes.
    pub fn new(id: impl Into<Id>, data: &[u8]) -> Option<Self> {
        let mut bytes = [0; 8];
        bytes.get_mut(..data.len())?.copy_from_slice(data);
        Some(Self {
            id: id.into(),
            is_remote: false,
            len: data.len() as u8,
            data: bytes,
        })
    }

    /// A remote frame, which asks for a data frame of `len` bytes; none if that is more than 8.
    pub fn remote(id: impl Into<Id>, len: usize) -> Option<Self> {
        (len <= 8).then(|| Self {
            id: id.into(),
            is_remote: true,
            len: len as u8,
            data: [0; 8],
        })
    }

    /// A data frame with an identifier of 11 bits; none if that or the data is too long.
    pub fn standard(id: u16, data: &[u8]) -> Option<Self> {
        Self::new(StandardId::new(id)?, data)
    }

    /// A data frame with an identifier of 29 bits; none if that or the data is too long.
    pub fn extended(id: u32, data: &[u8]) -> Option<Self> {
        Self::new(ExtendedId::new(id)?, data)
    }

    /// Its identifier.
    pub fn id(&self) -> Id {
        self.id
    }

    /// Its identifier as a number, if it has 11 bits.
    pub fn standard_id(&self) -> Option<u16> {
        match self.id {
            Id::Standard(id) => Some(id.as_raw()),
            Id::Extended(_) => None,
        }
    }

    /// Whether it is a remote frame.
    pub fn is_remote(&self) -> bool {
        self.is_remote
    }

    /// Its bytes; none of a remote frame.
    pub fn data(&self) -> &[u8] {
        match self.is_remote {
            true => &[],
            false => &self.data[..self.len.into()],
        }
    }

    /// The number of its bytes, or of those that a remote frame asks for.
    pub fn dlc(&self) -> usize {
        self.len.into()
    }

    /// Which of two goes first when both begin at once: less is first.
    pub fn arbitrate(&self, other: &Frame) -> Ordering {
        (self.id, self.is_remote).cmp(&(other.id, other.is_remote))
    }

    /// Its length on the wire with the space that follows it, in bits, if as many are stuffed as
    /// there can be: an upper bound.
    pub fn bits(&self) -> u32 {
        let data = match self.is_remote {
            true => 0,
            false => 8 * u32::from(self.len),
        };
        let (all, stuffable) = match self.id {
            Id::Standard(_) => (47, 34),
            Id::Extended(_) => (67, 54),
        };
        all + data + (stuffable + data - 1) / 4
    }
}

impl embedded_can::Frame for Frame {
    fn new(id: impl Into<Id>, data: &[u8]) -> Option<Self> {
        Frame::new(id, data)
    }

    fn new_remote(id: impl Into<Id>, dlc: usize) -> Option<Self> {
        Frame::remote(id, dlc)
    }

    fn is_extended(&self) -> bool {
        matches!(self.id, Id::Extended(_))
    }

    fn is_remote_frame(&self) -> bool {
        self.is_remote
    }

    fn id(&self) -> Id {
        self.id
    }

    fn dlc(&self) -> usize {
        self.dlc()
    }

    fn data(&self) -> &[u8] {
        self.data()
    }
}

/// As `candump` writes it.
impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.id {
            Id::Standard(id) => write!(f, "{:03X} [{}]", id.as_raw(), self.len)?,
            Id::Extended(id) => write!(f, "{:08X} [{}]", id.as_raw(), self.len)?,
        }
        if self.is_remote {
            return f.write_str(" remote request");
        }
        self.data()
            .iter()
            .try_for_each(|byte| write!(f, " {byte:02X}"))
    }
}

impl fmt::Debug for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Frame({self})")
    }
}
