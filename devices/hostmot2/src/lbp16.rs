//! LBP16: packets that read and write a card's memory spaces.
//!
//! A packet is a concatenation of commands:
//! `[command u16] [address u16 if bit 14] [data if bit 15]`, little-endian. Its answer is the data
//! read, in order, and nothing else; a packet that reads nothing has no answer.

mod packet;
mod parse;

pub use packet::{Packet, PacketError};
pub use parse::{Operation, Operations, ParseError};

/// The most bytes of a packet: what one Ethernet frame has room for.
pub const MAX_PACKET: usize = 1472;

/// The most elements that one command transfers.
pub const MAX_COUNT: u8 = 127;

/// A memory space of the card.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Space {
    /// The firmware's registers, 32 bits wide.
    HostMot2 = 0,
    /// The Ethernet chip's registers, 16 bits wide.
    Chip = 1,
    /// The EEPROM with the card's addresses, 16 bits wide.
    Eeprom = 2,
    /// The access to the FPGA's flash memory, 32 bits wide.
    Flash = 3,
    /// Timers and scratch registers, 16 bits wide.
    Timers = 4,
    /// Not used by the protocol.
    Reserved = 5,
    /// Status and error registers, 16 bits wide.
    Status = 6,
    /// What the card is: its name and versions, 16 bits wide.
    Board = 7,
}

impl Space {
    /// The space of this number's three low bits.
    pub const fn from_bits(bits: u16) -> Space {
        match bits & 7 {
            0 => Space::HostMot2,
            1 => Space::Chip,
            2 => Space::Eeprom,
            3 => Space::Flash,
            4 => Space::Timers,
            5 => Space::Reserved,
            6 => Space::Status,
            _ => Space::Board,
        }
    }
}

/// How wide an element is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Width {
    /// One byte.
    Bits8 = 0,
    /// Two bytes.
    Bits16 = 1,
    /// Four bytes.
    Bits32 = 2,
    /// Eight bytes.
    Bits64 = 3,
}

impl Width {
    /// How many bytes an element has.
    pub const fn bytes(self) -> usize {
        1 << self as usize
    }

    /// The width of this number's two low bits.
    pub const fn from_bits(bits: u16) -> Width {
        match bits & 3 {
            0 => Width::Bits8,
            1 => Width::Bits16,
            2 => Width::Bits32,
            _ => Width::Bits64,
        }
    }
}

/// One command of a packet, without its data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Command {
    /// Whether it writes; else it reads.
    pub write: bool,
    /// Whether it is about the space's info area and not the space itself.
    pub info: bool,
    /// Which space.
    pub space: Space,
    /// How wide the elements are.
    pub width: Width,
    /// Whether the address advances with each element; else all are read from or written to one
    /// address.
    pub increment: bool,
    /// How many elements, 1 to [`MAX_COUNT`].
    pub count: u8,
    /// The start address, in bytes; without it, the end of the space's last command.
    pub address: Option<u16>,
}

const WRITE: u16 = 1 << 15;
const ADDRESS: u16 = 1 << 14;
const INFO: u16 = 1 << 13;
const INCREMENT: u16 = 1 << 7;

impl Command {
    /// The command's first word. A count beyond [`MAX_COUNT`] loses its high bit.
    pub const fn word(&self) -> u16 {
        (if self.write { WRITE } else { 0 })
            | (if self.address.is_some() { ADDRESS } else { 0 })
            | (if self.info { INFO } else { 0 })
            | (self.space as u16) << 10
            | (self.width as u16) << 8
            | (if self.increment { INCREMENT } else { 0 })
            | (self.count & MAX_COUNT) as u16
    }

    /// Whether a command with this first word is followed by an address.
    pub const fn has_address(word: u16) -> bool {
        word & ADDRESS != 0
    }

    /// The command of this word and address; none if it transfers nothing.
    pub const fn from_word(word: u16, address: Option<u16>) -> Option<Command> {
        let count = (word & MAX_COUNT as u16) as u8;
        if count == 0 {
            return None;
        }
        Some(Command {
            write: word & WRITE != 0,
            info: word & INFO != 0,
            space: Space::from_bits(word >> 10),
            width: Width::from_bits(word >> 8),
            increment: word & INCREMENT != 0,
            count,
            address,
        })
    }

    /// How many bytes it transfers: at most 1016.
    pub const fn data_len(&self) -> usize {
        self.count as usize * self.width.bytes()
    }
}

/// The elements of an answer, taken one after the other.
#[derive(Debug, Clone, Copy)]
pub struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    /// Begins at the first byte of `bytes`.
    pub const fn new(bytes: &'a [u8]) -> Self {
        Reader(bytes)
    }

    /// The next `N` bytes, if there are that many.
    pub fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (taken, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*taken)
    }

    /// The next two bytes as a number.
    pub fn u16(&mut self) -> Option<u16> {
        self.take().map(u16::from_le_bytes)
    }

    /// The next four bytes as a number.
    pub fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    /// The rest.
    pub const fn rest(&self) -> &'a [u8] {
        self.0
    }
}
