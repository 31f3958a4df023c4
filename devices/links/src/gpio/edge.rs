//! The edges of inputs, in the kernel's format.

use luna::external::{Framing, FromBytes, Malformed};
use std::time::Duration;

/// The framing of edges: records of 48 bytes, `struct gpio_v2_line_event`.
pub const FRAMING: Framing = Framing::fixed(48);

/// An edge of an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct Edge {
    /// The line's offset on its chip.
    pub offset: u32,
    /// From low to high; else from high to low.
    pub rising: bool,
    /// When the kernel saw it, on the monotonic clock (ns resolution).
    pub time: Duration,
    /// Its number among the edges of all lines of the request, from 1. A gap is the number of edges
    /// that the kernel dropped for lack of room.
    pub number: u32,
}

impl FromBytes for Edge {
    /// As the machine has them: in its own order of bytes.
    ///
    /// ```
    /// use luna::external::FromBytes;
    /// use luna_links::gpio::Edge;
    ///
    /// let mut bytes = [0; 48];
    /// bytes[..8].copy_from_slice(&1_000_000_u64.to_ne_bytes()); // ns
    /// bytes[8..12].copy_from_slice(&1_u32.to_ne_bytes()); // rising
    /// bytes[12..16].copy_from_slice(&22_u32.to_ne_bytes());
    /// let edge = Edge::from_bytes(&bytes).unwrap();
    /// assert_eq!((edge.offset, edge.rising, edge.time.as_millis()), (22, true, 1));
    /// ```
    fn from_bytes(bytes: &[u8]) -> Result<Self, Malformed> {
        let word = |at: usize| {
            let bytes = bytes.get(at..at + 4)?;
            Some(u32::from_ne_bytes(bytes.try_into().ok()?))
        };
        let time = bytes
            .first_chunk()
            .map(|bytes| Duration::from_nanos(u64::from_ne_bytes(*bytes)));
        let (Some(time), Some(kind), Some(offset), Some(number), 48) =
            (time, word(8), word(12), word(16), bytes.len())
        else {
            return Err(Malformed("an edge has 48 bytes"));
        };
        let rising = match kind {
            1 => true,
            2 => false,
            _ => return Err(Malformed("an edge rises or falls")),
        };
        Ok(Self {
            offset,
            rising,
            time,
            number,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn malformed_events_are_refused() {
        let mut bytes = [0; 48];
        assert!(Edge::from_bytes(&bytes).is_err(), "kind 0");
        bytes[8..12].copy_from_slice(&2_u32.to_ne_bytes());
        bytes[16..20].copy_from_slice(&7_u32.to_ne_bytes());
        let edge = Edge::from_bytes(&bytes).unwrap();
        assert_eq!((edge.rising, edge.number), (false, 7));
        for length in [0, 7, 8, 20, 47] {
            assert!(Edge::from_bytes(&bytes[..length]).is_err(), "{length}");
        }
        assert!(Edge::from_bytes(&[1; 49]).is_err());
    }
}
