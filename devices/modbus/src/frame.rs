//! Requests and answers as bytes: rmodbus makes the requests, and what it leaves open of an answer
//! is checked here.

use crate::point::Place;
use crate::{AnswerUnit, Code, Garbage, Request, Table};
use rmodbus::client::ModbusRequest;
use rmodbus::{ErrorKind, ModbusProto, guess_response_frame_len};

/// The header before the unit.
pub(crate) const HEADER: usize = 6;

/// A request's bytes, and what its answer has to be.
#[derive(Debug)]
pub(crate) struct Frame {
    pub(crate) about: Request,
    pub(crate) bytes: Vec<u8>,
    request: ModbusRequest,
    answers: AnswerUnit,
}

/// What an answer says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Answer {
    Good,
    Refused(Code),
}

impl Frame {
    pub(crate) fn new(unit: u8, answers: AnswerUnit) -> Self {
        Self {
            about: Request {
                function: 0,
                table: Table::Coil,
                address: 0,
                count: 0,
            },
            bytes: Vec::with_capacity(64),
            request: ModbusRequest {
                // It counts up before each request.
                tr_id: 0,
                ..ModbusRequest::new(unit, ModbusProto::TcpUdp)
            },
            answers,
        }
    }

    /// Asks for values. The place is in its table, and no longer than an answer can be.
    pub(crate) fn read(&mut self, place: Place) -> Result<(), ErrorKind> {
        self.request.tr_id = self.request.tr_id.wrapping_add(1);
        let Self { request, bytes, .. } = self;
        let (address, width) = (place.address, place.width);
        match place.table {
            Table::Coil => request.generate_get_coils(address, width, bytes),
            Table::Discrete => request.generate_get_discretes(address, width, bytes),
            Table::Input => request.generate_get_inputs(address, width, bytes),
            Table::Holding => request.generate_get_holdings(address, width, bytes),
        }?;
        self.note(place);
        Ok(())
    }

    /// Asks to write a value: a bit, one register, or two.
    pub(crate) fn write(&mut self, place: Place, raw: [u16; 2]) -> Result<(), ErrorKind> {
        self.request.tr_id = self.request.tr_id.wrapping_add(1);
        let Self { request, bytes, .. } = self;
        match (place.table, place.width) {
            (Table::Coil, _) => request.generate_set_coil(place.address, raw[0] != 0, bytes),
            (_, 1) => request.generate_set_holding(place.address, raw[0], bytes),
            _ => request.generate_set_holdings_bulk(place.address, &raw, bytes),
        }?;
        self.note(place);
        Ok(())
    }

    fn note(&mut self, place: Place) {
        self.about = Request {
            function: self.request.func.byte(),
            table: place.table,
            address: place.address,
            count: place.width,
        };
    }

    /// The length of the answer with this header.
    pub(crate) fn answer_len(header: &[u8]) -> Result<usize, Garbage> {
        match guess_response_frame_len(header, ModbusProto::TcpUdp) {
            // The unit, the function, and at least a byte.
            Ok(len) if header[2..4] == [0, 0] && usize::from(len) >= HEADER + 3 => Ok(len.into()),
            _ => Err(Garbage::Header),
        }
    }

    /// Whether the answer with this header is for this request. One with the transaction of none
    /// that waits is to be discarded.
    pub(crate) fn is_answered_by(&self, header: &[u8]) -> bool {
        header[..2] == self.bytes[..2]
    }

    /// Judges a complete answer to this request, and appends the values of a read to `values`.
    pub(crate) fn judge(
        &self,
        answer: &mut [u8],
        values: &mut Vec<u16>,
    ) -> Result<Answer, Garbage> {
        if answer.len() < HEADER + 3 {
            return Err(Garbage::Header);
        }
        let asked = self.request.unit_id;
        match self.answers {
            AnswerUnit::Asked if answer[6] == asked => {}
            AnswerUnit::Is(unit) if answer[6] == unit => {}
            AnswerUnit::Any => {}
            _ => return Err(Garbage::Unit),
        }
        // For what follows it is that of the request.
        answer[6] = asked;
        let function = self.about.function;
        if answer[7] == function | 0x80 {
            return match answer.len() {
                9 => Ok(Answer::Refused(Code::of(answer[8]))),
                _ => Err(Garbage::Length),
            };
        }
        if answer[7] != function {
            return Err(Garbage::Function);
        }
        if self.request.func.is_write() {
            // Unit, function, address, and value or count come back.
            return match answer.len() == HEADER + 6 && answer[6..] == self.bytes[6..12] {
                true => Ok(Answer::Good),
                false => Err(Garbage::Echo),
            };
        }
        let count = usize::from(self.about.count);
        let is_bits = matches!(self.about.table, Table::Coil | Table::Discrete);
        let len = if is_bits {
            count.div_ceil(8)
        } else {
            count * 2
        };
        if usize::from(answer[8]) != len || answer.len() != HEADER + 3 + len {
            return Err(Garbage::Length);
        }
        let parsed = if is_bits {
            let mut bits = Vec::with_capacity(count);
            let parsed = self.request.parse_bool(answer, &mut bits);
            values.extend(bits.into_iter().map(u16::from));
            parsed
        } else {
            // It appends at most as many as were asked for to what is there.
            let mut words = Vec::with_capacity(count);
            let parsed = self.request.parse_u16(answer, &mut words);
            values.append(&mut words);
            parsed
        };
        parsed.map(|()| Answer::Good).map_err(|_| Garbage::Length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn place(table: Table, address: u16, width: u16) -> Place {
        Place {
            table,
            address,
            width,
        }
    }

    fn asked(place: Place) -> Frame {
        let mut frame = Frame::new(7, AnswerUnit::Asked);
        frame.read(place).unwrap();
        frame
    }

    #[test]
    fn a_request_is_as_the_protocol_says() {
        let mut frame = Frame::new(7, AnswerUnit::Asked);
        frame.read(place(Table::Holding, 0x6B, 3)).unwrap();
        assert_eq!(frame.bytes, [0, 1, 0, 0, 0, 6, 7, 3, 0, 0x6B, 0, 3]);
        frame.write(place(Table::Coil, 0xAC, 1), [1, 0]).unwrap();
        assert_eq!(frame.bytes, [0, 2, 0, 0, 0, 6, 7, 5, 0, 0xAC, 0xFF, 0]);
        frame.write(place(Table::Holding, 1, 1), [3, 0]).unwrap();
        assert_eq!(frame.bytes, [0, 3, 0, 0, 0, 6, 7, 6, 0, 1, 0, 3]);
        frame
            .write(place(Table::Holding, 1, 2), [10, 0x102])
            .unwrap();
        let expected = [0, 4, 0, 0, 0, 11, 7, 16, 0, 1, 0, 2, 4, 0, 10, 1, 2];
        assert_eq!(frame.bytes, expected);
    }

    #[test]
    fn each_kind_of_garbage_is_named() {
        let frame = asked(place(Table::Input, 8, 1));
        let good = [0, 1, 0, 0, 0, 5, 7, 4, 2, 0, 10];
        let judge = |answer: &[u8]| frame.judge(&mut answer.to_vec(), &mut Vec::new());
        assert_eq!(judge(&good), Ok(Answer::Good));
        let changed = |at: usize, to: u8| {
            let mut answer = good;
            answer[at] = to;
            judge(&answer)
        };
        assert!(frame.is_answered_by(&good) && !frame.is_answered_by(&[0, 2, 0, 0, 0, 5]));
        assert_eq!(changed(6, 8), Err(Garbage::Unit));
        assert_eq!(changed(7, 3), Err(Garbage::Function));
        assert_eq!(changed(8, 4), Err(Garbage::Length));
        let refused = [0, 1, 0, 0, 0, 3, 7, 0x84, 11];
        assert_eq!(
            judge(&refused),
            Ok(Answer::Refused(Code::NoAnswerBehindGateway))
        );
        assert_eq!(Frame::answer_len(&[0, 1, 0, 1, 0, 5]), Err(Garbage::Header));
        assert_eq!(Frame::answer_len(&[0, 1, 0, 0, 0, 2]), Err(Garbage::Header));
        assert_eq!(Frame::answer_len(&[0, 1, 0, 0, 1, 2]), Err(Garbage::Header));
        assert_eq!(Frame::answer_len(&[0, 1, 0, 0, 0, 5]), Ok(11));
        let mut write = Frame::new(7, AnswerUnit::Asked);
        write.write(place(Table::Holding, 1, 1), [3, 0]).unwrap();
        let mut echo = write.bytes.clone();
        assert_eq!(write.judge(&mut echo, &mut Vec::new()), Ok(Answer::Good));
        echo[11] = 4;
        assert_eq!(write.judge(&mut echo, &mut Vec::new()), Err(Garbage::Echo));
    }

    #[test]
    fn the_unit_of_an_answer_is_what_was_said() {
        for (answers, taken) in [
            (AnswerUnit::Asked, [false, true, false]),
            (AnswerUnit::Is(0), [true, false, false]),
            (AnswerUnit::Is(255), [false, false, true]),
            (AnswerUnit::Any, [true; 3]),
        ] {
            for (unit, is_taken) in [0, 7, 255].into_iter().zip(taken) {
                let mut frame = Frame::new(7, answers);
                frame.read(place(Table::Input, 8, 1)).unwrap();
                let mut values = Vec::new();
                let mut answer = [0, 1, 0, 0, 0, 5, unit, 4, 2, 0, 10];
                let judged = frame.judge(&mut answer, &mut values);
                match is_taken {
                    true => assert_eq!((judged, &*values), (Ok(Answer::Good), &[10][..])),
                    false => assert_eq!(judged, Err(Garbage::Unit), "{answers:?} {unit}"),
                }
                frame.write(place(Table::Holding, 1, 1), [3, 0]).unwrap();
                let mut echo = frame.bytes.clone();
                echo[6] = unit;
                let judged = frame.judge(&mut echo, &mut values);
                assert_eq!(judged.is_ok(), is_taken, "{answers:?} {unit}");
            }
        }
    }

    proptest! {
        /// Whatever comes: no panic, and a good answer to a read has all values.
        #[test]
        fn any_answer_is_judged(
            number in 0..4usize,
            width in 1..120u16,
            mut answer in prop::collection::vec(any::<u8>(), 0..260),
            is_alike: bool,
        ) {
            let table = [Table::Coil, Table::Discrete, Table::Input, Table::Holding][number];
            let frame = asked(place(table, 0, width));
            if is_alike && answer.len() >= 9 {
                answer[..8].copy_from_slice(&frame.bytes[..8]);
                answer[8] = (answer.len() - 9) as u8;
            }
            let mut values = Vec::new();
            if frame.judge(&mut answer, &mut values) == Ok(Answer::Good) {
                prop_assert_eq!(values.len(), usize::from(width));
            }
            if answer.len() >= HEADER {
                let _ = Frame::answer_len(&answer[..HEADER]);
                let _ = frame.is_answered_by(&answer[..HEADER]);
            }
        }
    }
}
