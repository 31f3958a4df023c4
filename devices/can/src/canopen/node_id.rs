//! The number of a node, and the identifiers that follow from it.

use std::fmt;

/// The number of a node: 1 to 127.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId(u8);

impl NodeId {
    /// None if the number is 0 or above 127.
    pub const fn new(number: u8) -> Option<Self> {
        match number {
            1..=127 => Some(Self(number)),
            _ => None,
        }
    }

    /// The number.
    pub const fn number(self) -> u8 {
        self.0
    }

    /// The identifier of its EMCY messages.
    pub const fn emergency(self) -> u16 {
        0x80 + self.0 as u16
    }

    /// The identifier of its heartbeat and its boot-up.
    pub const fn heartbeat(self) -> u16 {
        0x700 + self.0 as u16
    }

    /// The identifier of requests to its SDO server.
    pub const fn sdo_request(self) -> u16 {
        0x600 + self.0 as u16
    }

    /// The identifier of the answers of its SDO server.
    pub const fn sdo_response(self) -> u16 {
        0x580 + self.0 as u16
    }

    /// The usual identifier of one of the first four PDOs that it transmits, counted from 1; none
    /// for others.
    pub const fn tpdo(self, number: u8) -> Option<u16> {
        match number {
            1..=4 => Some(0x80 + 0x100 * number as u16 + self.0 as u16),
            _ => None,
        }
    }

    /// The usual identifier of one of the first four PDOs that it receives, counted from 1; none
    /// for others.
    pub const fn rpdo(self, number: u8) -> Option<u16> {
        match number {
            1..=4 => Some(0x100 + 0x100 * number as u16 + self.0 as u16),
            _ => None,
        }
    }

    /// The node of an identifier with this base.
    pub(crate) fn of(id: u16, base: u16) -> Option<Self> {
        match id & !0x7F == base {
            true => Self::new((id & 0x7F) as u8),
            false => None,
        }
    }
}

impl fmt::Display for NodeId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "node {}", self.0)
    }
}
