//! The SDO server of a simulated node.

use super::dictionary::Dictionary;
use crate::canopen::sdo::{Chunk, Request, Response, Short};
use crate::canopen::{AbortCode, Object};

/// A value that comes is no longer.
const LONGEST: usize = 1 << 20;

/// The transfer in segments that is under way.
#[derive(Debug, Default)]
pub(super) enum Transfer {
    #[default]
    None,
    Down {
        object: Object,
        size: Option<u32>,
        bytes: Vec<u8>,
        toggle: bool,
    },
    Up {
        object: Object,
        bytes: Vec<u8>,
        at: usize,
        toggle: bool,
    },
}

impl Transfer {
    /// Answers a request, if it has an answer.
    pub(super) fn answer(
        &mut self,
        bytes: &[u8; 8],
        dictionary: &mut Dictionary,
    ) -> Option<Response> {
        let request = Request::decode(bytes);
        let answered = match request {
            Some(Request::Abort { .. }) => {
                *self = Transfer::None;
                return None;
            }
            Some(request) => self.serve(request, dictionary),
            None => Err((Object::new(0, 0), AbortCode::UNKNOWN_COMMAND)),
        };
        Some(answered.unwrap_or_else(|(object, code)| {
            *self = Transfer::None;
            Response::Abort { object, code }
        }))
    }

    fn serve(
        &mut self,
        request: Request,
        dictionary: &mut Dictionary,
    ) -> Result<Response, (Object, AbortCode)> {
        match request {
            Request::Expedited { object, data } => {
                *self = Transfer::None;
                let bytes = match dictionary.fixed_len(object) {
                    Some(len) => data.of_len(len),
                    None => data.bytes(),
                };
                dictionary
                    .download(object, bytes)
                    .map_err(|code| (object, code))?;
                Ok(Response::Downloaded { object })
            }
            Request::Download { object, size } => {
                let may = dictionary.may_download(object);
                may.map_err(|code| (object, code))?;
                *self = Transfer::Down {
                    object,
                    size,
                    bytes: Vec::new(),
                    toggle: false,
                };
                Ok(Response::Downloaded { object })
            }
            Request::DownloadSegment {
                toggle,
                is_last,
                data,
            } => self.take(toggle, is_last, &data, dictionary),
            Request::Upload { object } => {
                let bytes = dictionary.upload(object).map_err(|code| (object, code))?;
                if (1..=4).contains(&bytes.len()) {
                    *self = Transfer::None;
                    let data = Short::new(bytes);
                    return Ok(Response::Expedited { object, data });
                }
                let size = u32::try_from(bytes.len()).ok();
                *self = Transfer::Up {
                    object,
                    bytes: bytes.to_vec(),
                    at: 0,
                    toggle: false,
                };
                Ok(Response::Upload { object, size })
            }
            Request::UploadSegment { toggle } => self.give(toggle),
            // It was handled before.
            Request::Abort { object, .. } => Err((object, AbortCode::GENERAL)),
        }
    }

    fn take(
        &mut self,
        toggle: bool,
        is_last: bool,
        data: &Chunk,
        dictionary: &mut Dictionary,
    ) -> Result<Response, (Object, AbortCode)> {
        let Transfer::Down {
            object,
            size,
            bytes,
            toggle: expected,
        } = self
        else {
            return Err((Object::new(0, 0), AbortCode::UNKNOWN_COMMAND));
        };
        let object = *object;
        if toggle != *expected {
            return Err((object, AbortCode::TOGGLE));
        }
        *expected = !toggle;
        bytes.extend_from_slice(data.bytes());
        if bytes.len() > LONGEST {
            return Err((object, AbortCode::OUT_OF_MEMORY));
        }
        if is_last {
            if size.is_some_and(|size| size as usize != bytes.len()) {
                return Err((object, AbortCode::WRONG_LENGTH));
            }
            let bytes = std::mem::take(bytes);
            *self = Transfer::None;
            dictionary
                .download(object, &bytes)
                .map_err(|code| (object, code))?;
        }
        Ok(Response::SegmentTaken { toggle })
    }

    fn give(&mut self, toggle: bool) -> Result<Response, (Object, AbortCode)> {
        let Transfer::Up {
            object,
            bytes,
            at,
            toggle: expected,
        } = self
        else {
            return Err((Object::new(0, 0), AbortCode::UNKNOWN_COMMAND));
        };
        if toggle != *expected {
            return Err((*object, AbortCode::TOGGLE));
        }
        *expected = !toggle;
        let data = Chunk::new(&bytes[*at..]);
        *at += data.bytes().len();
        let is_last = *at == bytes.len();
        if is_last {
            *self = Transfer::None;
        }
        Ok(Response::Segment {
            toggle,
            is_last,
            data,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::canopen::NodeId;
    use proptest::prelude::*;

    proptest! {
        /// Whatever comes, in whatever order: an answer or none, and no panic.
        #[test]
        fn any_requests_are_answered(
            requests in prop::collection::vec(any::<[u8; 8]>(), 0..40),
            is_near: bool,
        ) {
            let mut dictionary = Dictionary::new(NodeId::new(5).unwrap());
            let mut transfer = Transfer::default();
            for mut request in requests {
                if is_near {
                    // An object that there is.
                    let [_, low, high, sub, ..] = &mut request;
                    (*low, *high, *sub) = (*low & 7, 0x1A, *sub & 7);
                }
                if let Some(answer) = transfer.answer(&request, &mut dictionary) {
                    prop_assert_eq!(Response::decode(&answer.encode()), Some(answer));
                }
            }
            for number in 0..super::super::dictionary::PDOS {
                let _ = (dictionary.pdo(0x1800, number), dictionary.pdo(0x1400, number));
            }
        }
    }
}
