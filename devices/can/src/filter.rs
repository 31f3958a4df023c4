//! Which frames a receiver gets.

use crate::Frame;
use embedded_can::{ExtendedId, Id, StandardId};

/// A set of identifiers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Filter(pub(crate) Kind);

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Kind {
    Any,
    Standard { id: u16, mask: u16 },
    Extended { id: u32, mask: u32 },
}

impl Filter {
    /// All frames.
    pub const ANY: Filter = Filter(Kind::Any);

    /// Frames with this identifier alone.
    pub fn exact(id: impl Into<Id>) -> Self {
        match id.into() {
            Id::Standard(id) => Self::standard(id.as_raw(), StandardId::MAX.as_raw()),
            Id::Extended(id) => Self::extended(id.as_raw(), ExtendedId::MAX.as_raw()),
        }
    }

    /// Frames with identifiers of 11 bits that are as `id` where `mask` has ones. Only 11 bits of
    /// both count.
    pub const fn standard(id: u16, mask: u16) -> Self {
        let (id, mask) = (id & 0x7FF, mask & 0x7FF);
        Self(Kind::Standard { id, mask })
    }

    /// Frames with identifiers of 29 bits that are as `id` where `mask` has ones. Only 29 bits of
    /// both count: the others are flags of the kernel's filters.
    pub const fn extended(id: u32, mask: u32) -> Self {
        let (id, mask) = (id & 0x1FFF_FFFF, mask & 0x1FFF_FFFF);
        Self(Kind::Extended { id, mask })
    }

    /// Whether a frame is in the set. Real-time path: O(1).
    pub fn matches(&self, frame: &Frame) -> bool {
        match (self.0, frame.id()) {
            (Kind::Any, _) => true,
            (Kind::Standard { id, mask }, Id::Standard(of)) => (of.as_raw() ^ id) & mask == 0,
            (Kind::Extended { id, mask }, Id::Extended(of)) => (of.as_raw() ^ id) & mask == 0,
            _ => false,
        }
    }
}
