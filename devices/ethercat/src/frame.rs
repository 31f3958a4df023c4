//! Ethernet frames of EtherCAT: a writer for the few that the library does not make, and a reader
//! for the simulation.

/// The Ethernet type of EtherCAT.
pub(crate) const ETHER_TYPE: u16 = 0x88a4;
/// Of an Ethernet frame, without its checksum.
pub(crate) const MAX_FRAME: usize = 1514;
/// The bytes before the first datagram.
pub(crate) const HEADERS: usize = 16;
/// The header and the working counter of a datagram.
const DATAGRAM: usize = 12;
/// The sender of all frames, also of the library's.
const SENDER: [u8; 6] = [0x10; 6];
/// Where the sender's address is.
const SENDER_AT: usize = 6;
/// The part of it that subdevices leave as it is.
const TAG_AT: std::ops::Range<usize> = 8..12;
/// That part of [`SENDER`].
pub(crate) const SENDER_TAG: u32 = 0x1010_1010;
const MORE: u16 = 1 << 15;
const LENGTH: u16 = 0x07ff;

/// The commands of datagrams.
pub(crate) mod command {
    pub(crate) const APRD: u8 = 1;
    pub(crate) const APWR: u8 = 2;
    pub(crate) const FPRD: u8 = 4;
    pub(crate) const FPWR: u8 = 5;
    pub(crate) const BRD: u8 = 7;
    pub(crate) const BWR: u8 = 8;
    pub(crate) const LRD: u8 = 10;
    pub(crate) const LWR: u8 = 11;
    pub(crate) const LRW: u8 = 12;
    pub(crate) const FRMW: u8 = 14;
}

/// Writes a frame of several datagrams.
#[derive(Debug)]
pub(crate) struct Writer {
    bytes: Vec<u8>,
    /// Where the length of the last datagram is.
    last: Option<usize>,
}

impl Writer {
    pub(crate) fn new() -> Self {
        let mut bytes = vec![0xff; 6];
        bytes.extend(SENDER);
        bytes.extend(ETHER_TYPE.to_be_bytes());
        bytes.extend([0; 2]);
        Self { bytes, last: None }
    }

    /// Appends a datagram to `address`: a register in the upper half for broadcasts, or a logical
    /// address.
    pub(crate) fn datagram(mut self, command: u8, address: u32, data: &[u8]) -> Self {
        if let Some(last) = self.last {
            let flags = word(&self.bytes, last) | MORE;
            self.bytes[last..last + 2].copy_from_slice(&flags.to_le_bytes());
        }
        self.bytes.extend([command, 0]);
        self.bytes.extend(address.to_le_bytes());
        self.last = Some(self.bytes.len());
        self.bytes
            .extend((data.len() as u16 & LENGTH).to_le_bytes());
        self.bytes.extend([0; 2]);
        self.bytes.extend(data);
        self.bytes.extend([0; 2]);
        self
    }

    pub(crate) fn finish(mut self) -> Vec<u8> {
        let length = (self.bytes.len() - HEADERS) as u16 | 1 << 12;
        self.bytes[HEADERS - 2..HEADERS].copy_from_slice(&length.to_le_bytes());
        self.bytes
    }
}

/// A datagram on its way through the subdevices.
#[derive(Debug)]
pub(crate) struct Datagram<'a> {
    pub(crate) command: u8,
    /// The station's address, or the lower half of a logical one.
    pub(crate) station: &'a mut [u8],
    /// The register, or the upper half of a logical address.
    pub(crate) register: u16,
    pub(crate) data: &'a mut [u8],
    counter: &'a mut [u8],
}

impl Datagram<'_> {
    pub(crate) fn address(&self) -> u16 {
        word(self.station, 0)
    }

    /// Counts on the position, as each subdevice does.
    pub(crate) fn pass(&mut self) {
        let next = self.address().wrapping_add(1);
        self.station.copy_from_slice(&next.to_le_bytes());
    }

    pub(crate) fn logical(&self) -> u32 {
        u32::from(self.address()) | u32::from(self.register) << 16
    }

    pub(crate) fn count(&mut self, by: u16) {
        let counter = word(self.counter, 0).wrapping_add(by);
        self.counter.copy_from_slice(&counter.to_le_bytes());
    }

    /// Makes the working counter wrong.
    pub(crate) fn miscount(&mut self) {
        let counter = word(self.counter, 0).saturating_sub(1);
        self.counter.copy_from_slice(&counter.to_le_bytes());
    }
}

/// Whether `frame` is one of EtherCAT that no subdevice has answered yet.
pub(crate) fn is_request(frame: &[u8]) -> bool {
    frame.len() > HEADERS
        && frame[12..14] == ETHER_TYPE.to_be_bytes()
        && frame[SENDER_AT] & 0x02 == 0
}

/// Writes a tag into the sender's address: the answer has it too.
pub(crate) fn tag(frame: &mut [u8], tag: u32) {
    if let Some(part) = frame.get_mut(TAG_AT) {
        part.copy_from_slice(&tag.to_be_bytes());
    }
}

/// Replaces the tag by what all frames of the library have there. Returns the tag; none if the
/// frame is too short.
pub(crate) fn take_tag(frame: &mut [u8]) -> Option<u32> {
    let part = frame.get_mut(TAG_AT)?.first_chunk_mut()?;
    let tag = u32::from_be_bytes(*part);
    *part = SENDER_TAG.to_be_bytes();
    Some(tag)
}

/// Marks the frame as answered, as the first subdevice does.
pub(crate) fn mark_answered(frame: &mut [u8]) {
    frame[SENDER_AT] |= 0x02;
}

/// The datagrams of a frame, in order.
pub(crate) fn datagrams(frame: &mut [u8]) -> impl Iterator<Item = Datagram<'_>> {
    let mut rest = frame.get_mut(HEADERS..).unwrap_or_default();
    let mut is_last = false;
    std::iter::from_fn(move || {
        let taken = std::mem::take(&mut rest);
        if is_last || taken.len() < DATAGRAM {
            return None;
        }
        let flags = word(taken, 6);
        let length = usize::from(flags & LENGTH);
        is_last = flags & MORE == 0;
        if taken.len() < DATAGRAM + length {
            return None;
        }
        let (this, others) = taken.split_at_mut(DATAGRAM + length);
        rest = others;
        let (header, body) = this.split_at_mut(10);
        let (data, counter) = body.split_at_mut(length);
        Some(Datagram {
            command: header[0],
            register: word(header, 4),
            station: &mut header[2..4],
            data,
            counter,
        })
    })
}

/// The word at a place, in the order of EtherCAT.
pub(crate) fn word(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let mut frame = Writer::new()
            .datagram(command::LWR, 0x0001_0002, &[1, 2, 3])
            .datagram(command::BWR, 0x0120_0000, &[4, 0])
            .finish();
        assert!(is_request(&frame));
        mark_answered(&mut frame);
        assert!(!is_request(&frame));
        let seen: Vec<_> = datagrams(&mut frame)
            .map(|mut each| {
                each.count(3);
                (each.command, each.logical(), each.data.to_vec())
            })
            .collect();
        let expected = [
            (command::LWR, 0x0001_0002, vec![1, 2, 3]),
            (command::BWR, 0x0120_0000, vec![4, 0]),
        ];
        assert_eq!(seen, expected);
        assert!(datagrams(&mut frame).all(|each| word(each.counter, 0) == 3));
    }

    #[test]
    fn a_tag_comes_back_with_the_answer() {
        let frame = Writer::new().datagram(command::BRD, 0, &[0; 4]).finish();
        let mut tagged = frame.clone();
        tag(&mut tagged, 0x0102_0304);
        assert!(is_request(&tagged));
        mark_answered(&mut tagged);
        assert_eq!(take_tag(&mut tagged), Some(0x0102_0304));
        assert_eq!(tagged[SENDER_AT + 1..], frame[SENDER_AT + 1..]);
        assert_eq!(take_tag(&mut tagged), Some(SENDER_TAG));
        assert_eq!(take_tag(&mut tagged[..11]), None);
    }

    #[test]
    fn a_frame_that_is_cut_has_fewer_datagrams() {
        let frame = Writer::new()
            .datagram(command::BRD, 0, &[0; 4])
            .datagram(command::BRD, 0, &[0; 4])
            .finish();
        for length in 0..frame.len() {
            let mut cut = frame[..length].to_vec();
            let whole = length.saturating_sub(HEADERS) / (DATAGRAM + 4);
            assert_eq!(datagrams(&mut cut).count(), whole, "of {length} bytes");
        }
    }
}
