//! Events in the kernel's format.

use luna::external::{Framing, FromBytes, Malformed};

/// The time comes first: two words of the machine.
const TIME: usize = 2 * size_of::<usize>();
const SIZE: usize = TIME + 8;

/// The framing of events: records of one `struct input_event`.
pub const FRAMING: Framing = Framing::fixed(SIZE);

/// An event of an input device: `struct input_event`, without its time. The numbers are those of
/// the kernel's `input-event-codes.h`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Event {
    /// Its type: 0 is a synchronization, 1 a button, 3 an axis.
    pub kind: u16,
    /// Which button or axis.
    pub code: u16,
    /// The position in the device's units; 1 pressed, 0 released, 2 repeated.
    pub value: i32,
}

impl Event {
    pub(crate) const SYNCHRONIZATION: u16 = 0;
    pub(crate) const BUTTON: u16 = 1;
    pub(crate) const AXIS: u16 = 3;
    /// Of a synchronization: what came before belongs together.
    pub(crate) const REPORT: u16 = 0;
    /// Of a synchronization: events were lost.
    pub(crate) const DROPPED: u16 = 3;
}

impl FromBytes for Event {
    /// As the machine has them: in its own order of bytes.
    ///
    /// ```
    /// use luna::external::FromBytes;
    /// use luna_links::joystick::Event;
    ///
    /// let mut bytes = vec![0; 2 * size_of::<usize>()]; // the time
    /// bytes.extend(3_u16.to_ne_bytes()); // an axis
    /// bytes.extend(1_u16.to_ne_bytes()); // Y
    /// bytes.extend((-5_i32).to_ne_bytes());
    /// assert_eq!(Event::from_bytes(&bytes), Ok(Event { kind: 3, code: 1, value: -5 }));
    /// ```
    fn from_bytes(bytes: &[u8]) -> Result<Self, Malformed> {
        if bytes.len() == SIZE
            && let &[a, b, c, d, e, f, g, h] = &bytes[TIME..]
        {
            return Ok(Self {
                kind: u16::from_ne_bytes([a, b]),
                code: u16::from_ne_bytes([c, d]),
                value: i32::from_ne_bytes([e, f, g, h]),
            });
        }
        Err(Malformed("an input event has another size"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_other_size_is_an_event() {
        for length in (0..60).filter(|length| *length != SIZE) {
            assert!(Event::from_bytes(&vec![1; length]).is_err(), "{length}");
        }
    }
}
