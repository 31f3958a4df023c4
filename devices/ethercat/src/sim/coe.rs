//! The mailbox of a simulated subdevice: requests of CoE, and their answers.

use super::abort::{self, Abort};
use super::application::Application;
use super::dictionary::{self, Dictionary, Place};
use super::sii::MAILBOX_LENGTH;
use crate::frame::word;
use crate::{SdoValue, State};
use std::time::Duration;

const LENGTH: usize = MAILBOX_LENGTH as usize;
/// The headers of the mailbox, of CoE and of the SDO, and four bytes of data.
const MESSAGE: usize = 16;
const COE: u8 = 3;
const EMERGENCY: u8 = 1;
const SDO_REQUEST: u8 = 2;
const SDO_RESPONSE: u8 = 3;
/// An answer to what is not CoE.
const ERROR: u8 = 0;
const UNSUPPORTED_PROTOCOL: u16 = 2;

/// The commands of SDOs, in the upper three bits.
const DOWNLOAD: u8 = 1;
const UPLOAD: u8 = 2;
const ABORT: u8 = 4;
const DOWNLOADED: u8 = 3;
const EXPEDITED: u8 = 0b10;
const SIZED: u8 = 0b01;
const COMPLETE: u8 = 0x10;

#[derive(Debug)]
pub(super) struct Coe {
    pub(super) dictionary: Dictionary,
    /// Where the application's values are in outputs, and in inputs.
    layout: [Vec<Place>; 2],
    /// The application's values, in its own order.
    signals: [Vec<u8>; 2],
    /// Requests are taken, and never answered.
    pub(super) hangs: bool,
    /// The code of an emergency that is sent before the next answer.
    pub(super) emergency: Option<u16>,
    counter: u8,
}

/// An SDO that is requested.
struct Request {
    index: u16,
    sub: u8,
}

impl Coe {
    pub(super) fn new(dictionary: Dictionary) -> Self {
        let signals = [0, 1].map(|it| vec![0; dictionary.signal_bits(it).div_ceil(8)]);
        Self {
            layout: [0, 1].map(|direction| dictionary.layout(direction).0),
            dictionary,
            signals,
            hangs: false,
            emergency: None,
            counter: 0,
        }
    }

    /// The bytes of outputs, and of inputs.
    pub(super) fn lengths(&self) -> [usize; 2] {
        [0, 1].map(|direction| self.dictionary.layout(direction).1.div_ceil(8))
    }

    /// Lets the application run.
    pub(super) fn step(
        &mut self,
        application: &mut dyn Application,
        elapsed: Duration,
        from: &[u8],
        to: &mut [u8],
    ) {
        let [outputs, inputs] = &mut self.signals;
        // What is not mapped is zero.
        outputs.fill(0);
        for place in &self.layout[0] {
            copy(from, place.data, outputs, place.signal, place.bits);
        }
        for place in &self.layout[1] {
            copy(to, place.data, inputs, place.signal, place.bits);
        }
        application.step(elapsed, outputs, inputs);
        for place in &self.layout[1] {
            copy(inputs, place.signal, to, place.data, place.bits);
        }
    }

    /// What an object has.
    pub(super) fn value(&self, index: u16, sub: u8) -> Result<SdoValue, Abort> {
        for direction in [0, 1] {
            let Some((from, bits)) = self.dictionary.signal(direction, index, sub) else {
                continue;
            };
            if bits > 32 {
                return Err(abort::TOO_LARGE);
            }
            let mut bytes = [0; 4];
            copy(&self.signals[direction], from, &mut bytes, 0, bits);
            let kind = match bits {
                0..=8 => SdoValue::U8(0),
                9..=16 => SdoValue::U16(0),
                _ => SdoValue::U32(0),
            };
            return Ok(kind.with(bytes));
        }
        self.dictionary.read(index, sub)
    }

    /// The message of an emergency, if it has one to report.
    pub(super) fn report(&mut self) -> Option<[u8; LENGTH]> {
        let code = self.emergency.take()?;
        let mut message = [0; LENGTH];
        self.counter = self.counter % 7 + 1;
        message[0] = 10;
        message[5] = COE | self.counter << 4;
        message[7] = EMERGENCY << 4;
        message[8..10].copy_from_slice(&code.to_le_bytes());
        Some(message)
    }

    /// Answers a request. None if it hangs. Returns also whether process data has another layout.
    pub(super) fn answer(
        &mut self,
        request: &[u8],
        application: &mut dyn Application,
        state: State,
    ) -> Option<([u8; LENGTH], bool)> {
        let header = request.first_chunk::<MESSAGE>().filter(|_| !self.hangs)?;
        let mut answer = [0; LENGTH];
        self.counter = self.counter % 7 + 1;
        if header[5] & 0x0f != COE {
            answer[0] = 4;
            answer[5] = ERROR | self.counter << 4;
            answer[6] = 1;
            answer[8..10].copy_from_slice(&UNSUPPORTED_PROTOCOL.to_le_bytes());
            return Some((answer, false));
        }
        let mut is_mapped = false;
        let wanted = Request {
            index: word(header, 9),
            sub: header[11],
        };
        let outcome = match (header[7] >> 4, header[8] >> 5) {
            _ if header[8] & COMPLETE != 0 => Err(abort::UNSUPPORTED),
            (SDO_REQUEST, UPLOAD) => self.value(wanted.index, wanted.sub).map(Some),
            (SDO_REQUEST, DOWNLOAD) if header[8] & EXPEDITED != 0 => {
                // Without a stated size all four bytes are data.
                let unused = match header[8] & SIZED {
                    0 => 0,
                    _ => header[8] >> 2 & 3,
                };
                let bytes = &header[12..MESSAGE - usize::from(unused)];
                let written = self.download(&wanted, bytes, application, state);
                written.map(|changes| {
                    is_mapped = changes;
                    None
                })
            }
            _ => Err(abort::COMMAND),
        };
        answer[0] = 10;
        answer[5] = COE | self.counter << 4;
        answer[9..11].copy_from_slice(&wanted.index.to_le_bytes());
        answer[11] = wanted.sub;
        let (service, command, data) = match outcome {
            Ok(Some(value)) => {
                let unused = (4 - value.size()) as u8;
                let command = UPLOAD << 5 | unused << 2 | EXPEDITED | SIZED;
                (SDO_RESPONSE, command, value.bytes())
            }
            Ok(None) => (SDO_RESPONSE, DOWNLOADED << 5, [0; 4]),
            Err(code) => (SDO_REQUEST, ABORT << 5, code.to_le_bytes()),
        };
        answer[7] = service << 4;
        answer[8] = command;
        answer[12..MESSAGE].copy_from_slice(&data);
        Some((answer, is_mapped))
    }

    /// Returns whether process data has another layout.
    fn download(
        &mut self,
        to: &Request,
        bytes: &[u8],
        application: &mut dyn Application,
        state: State,
    ) -> Result<bool, Abort> {
        let Request { index, sub } = *to;
        if self.dictionary.signal(0, index, sub).is_some() {
            return Err(abort::IS_OUTPUT);
        }
        if self.dictionary.signal(1, index, sub).is_some() {
            return Err(abort::READ_ONLY);
        }
        let value = self.dictionary.parse(index, sub, bytes)?;
        if dictionary::is_mapping(index) {
            if state != State::PreOp {
                return Err(abort::STATE);
            }
        } else {
            application.configure(index, sub, value)?;
        }
        let changes = self.dictionary.write(index, sub, value)?;
        if changes {
            self.layout = [0, 1].map(|direction| self.dictionary.layout(direction).0);
        }
        Ok(changes)
    }
}

/// Copies bits; those beyond an end are left out.
fn copy(from: &[u8], first: usize, to: &mut [u8], at: usize, bits: usize) {
    if (first | at | bits).is_multiple_of(8) {
        let (first, at, bytes) = (first / 8, at / 8, bits / 8);
        let to = to.get_mut(at..at + bytes);
        if let (Some(to), Some(from)) = (to, from.get(first..first + bytes)) {
            to.copy_from_slice(from);
        }
        return;
    }
    for bit in 0..bits {
        let (source, target) = (first + bit, at + bit);
        let Some(is_set) = from.get(source / 8).map(|it| it >> (source % 8) & 1) else {
            return;
        };
        let Some(byte) = to.get_mut(target / 8) else {
            return;
        };
        *byte = *byte & !(1 << (target % 8)) | is_set << (target % 8);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_copied_to_where_they_belong() {
        let mut to = [0xff; 3];
        copy(&[0b0101_1010, 0], 1, &mut to, 6, 6);
        assert_eq!(to, [0b0111_1111, 0b1111_1011, 0xff]);
        let mut to = [0; 2];
        copy(&[1, 2, 3], 8, &mut to, 0, 16);
        assert_eq!(to, [2, 3]);
    }
}
