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
        // What is not mapped is zero: it was mapped in a state without outputs, if at all.
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

    #[derive(Debug)]
    struct Refuses;

    impl Application for Refuses {
        fn step(&mut self, _: Duration, _: &[u8], _: &mut [u8]) {}

        fn configure(&mut self, _: u16, _: u8, value: SdoValue) -> Result<(), u32> {
            if value == SdoValue::U16(0) {
                return Err(abort::VALUE);
            }
            Ok(())
        }
    }

    fn answer(coe: &mut Coe, request: [u8; MESSAGE], state: State) -> [u8; MESSAGE] {
        let (answer, _) = coe.answer(&request, &mut Refuses, state).unwrap();
        assert_eq!(answer[MESSAGE..], [0; LENGTH - MESSAGE]);
        *answer.first_chunk().unwrap()
    }

    /// Messages as ETG.1000.6 has them: mailbox, CoE, command, index, sub-index, data.
    #[test]
    fn messages_are_those_of_the_standard() {
        let dictionary = Dictionary::new()
            .object(0x2001, 2, 0x0304_u16)
            .output(0x7000, 1, 64)
            .pdo(0x1600, &[(0x7000, 1)]);
        let mut coe = Coe::new(dictionary);
        let mut ask = |state, request| answer(&mut coe, request, state);
        let write = [10, 0, 0, 0, 0, 0x13, 0, 0x20, 0x2b, 1, 0x20, 2, 9, 8, 0, 0];
        let written = [10, 0, 0, 0, 0, 0x13, 0, 0x30, 0x60, 1, 0x20, 2, 0, 0, 0, 0];
        assert_eq!(ask(State::Op, write), written);
        let read = [10, 0, 0, 0, 0, 0x23, 0, 0x20, 0x40, 1, 0x20, 2, 0, 0, 0, 0];
        let value = [10, 0, 0, 0, 0, 0x23, 0, 0x30, 0x4b, 1, 0x20, 2, 9, 8, 0, 0];
        assert_eq!(ask(State::Op, read), value);
        let mut aborts = |state, command: u8, index: u16, data: [u8; 4]| {
            let [low, high] = index.to_le_bytes();
            let mut request = [
                10, 0, 0, 0, 0, 0x13, 0, 0x20, command, low, high, 0, 0, 0, 0, 0,
            ];
            request[11] = if index == 0x2001 {
                2
            } else {
                u8::from(index == 0x7000)
            };
            request[12..].copy_from_slice(&data);
            let answer = ask(state, request);
            assert_eq!(answer[7..9], [0x20, 0x80]);
            u32::from_le_bytes(*answer.last_chunk().unwrap())
        };
        let any = [1; 4];
        let without_size = 0x22;
        assert_eq!(
            aborts(State::PreOp, without_size, 0x2001, any),
            abort::TOO_LONG
        );
        let complete = 0x3b;
        assert_eq!(
            aborts(State::PreOp, complete, 0x2001, any),
            abort::UNSUPPORTED
        );
        let normal = 0x21;
        assert_eq!(aborts(State::PreOp, normal, 0x2001, any), abort::COMMAND);
        assert_eq!(aborts(State::PreOp, 0x2b, 0x2001, [0; 4]), abort::VALUE);
        assert_eq!(aborts(State::PreOp, 0x40, 0x7000, any), abort::TOO_LARGE);
        // Process data has its layout outside of PRE-OP.
        assert_eq!(aborts(State::SafeOp, 0x2f, 0x1c12, [0; 4]), abort::STATE);
    }

    #[test]
    fn another_protocol_is_refused() {
        let mut coe = Coe::new(Dictionary::new());
        let mut request = [0; MESSAGE];
        request[5] = 0x14; // FoE
        let answer = answer(&mut coe, request, State::PreOp);
        assert_eq!(answer[..10], [4, 0, 0, 0, 0, 0x10, 1, 0, 2, 0]);
    }
}
