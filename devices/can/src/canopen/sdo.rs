//! The messages of SDO transfers, expedited and in segments.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use super::{AbortCode, Object};

/// Up to 7 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Chunk {
    len: u8,
    /// Zero from `len` on.
    bytes: [u8; 7],
}

impl Chunk {
    /// The first 7 of the bytes at most.
    pub(crate) fn new(bytes: &[u8]) -> Self {
        let len = bytes.len().min(7);
        let mut chunk = Self {
            len: len as u8,
            bytes: [0; 7],
        };
        chunk.bytes[..len].copy_from_slice(&bytes[..len]);
        chunk
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes[..self.len.into()]
    }
}

/// What is in one frame: 1 to 4 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Short {
    /// The size is stated.
    Sized(Chunk),
    /// It is not: as many of the bytes count as the object's type has.
    Unsized([u8; 4]),
}

impl Short {
    /// The first 4 of the bytes at most.
    pub(crate) fn new(bytes: &[u8]) -> Self {
        Short::Sized(Chunk::new(&bytes[..bytes.len().min(4)]))
    }

    /// The bytes; all that there are if the size is not stated.
    pub(crate) fn bytes(&self) -> &[u8] {
        match self {
            Short::Sized(data) => data.bytes(),
            Short::Unsized(bytes) => bytes,
        }
    }

    /// The bytes of an object of `len` bytes.
    pub(crate) fn of_len(&self, len: usize) -> &[u8] {
        match self {
            Short::Sized(data) => data.bytes(),
            Short::Unsized(bytes) => &bytes[..len.min(4)],
        }
    }
}

/// What a client asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Request {
    /// Writes 1 to 4 bytes.
    Expedited { object: Object, data: Short },
    /// Begins to write, of so many bytes if it says so.
    Download { object: Object, size: Option<u32> },
    /// Writes a segment of 1 to 7 bytes.
    DownloadSegment {
        toggle: bool,
        is_last: bool,
        data: Chunk,
    },
    /// Begins to read.
    Upload { object: Object },
    /// Reads a segment.
    UploadSegment { toggle: bool },
    /// Ends the transfer.
    Abort { object: Object, code: AbortCode },
}

/// What a server answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Response {
    /// It has written, or begins to.
    Downloaded { object: Object },
    /// It has taken a segment.
    SegmentTaken { toggle: bool },
    /// A value of 1 to 4 bytes.
    Expedited { object: Object, data: Short },
    /// It begins to send, so many bytes if it says so.
    Upload { object: Object, size: Option<u32> },
    /// A segment.
    Segment {
        toggle: bool,
        is_last: bool,
        data: Chunk,
    },
    /// Ends the transfer.
    Abort { object: Object, code: AbortCode },
}

type Bytes = [u8; 8];

fn with_object(command: u8, object: Object, data: [u8; 4]) -> Bytes {
    let [low, high] = object.index.to_le_bytes();
    let [a, b, c, d] = data;
    [command, low, high, object.sub, a, b, c, d]
}

fn object(bytes: &Bytes) -> Object {
    Object::new(u16::from_le_bytes([bytes[1], bytes[2]]), bytes[3])
}

fn word(bytes: &Bytes) -> u32 {
    u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]])
}

/// A begin: 4 bytes, and how many of them count if that is stated.
fn expedited(command: u8, of: Object, data: &Short) -> Bytes {
    match data {
        Short::Sized(data) => {
            let mut bytes = [0; 4];
            let len = data.bytes().len().min(4);
            bytes[..len].copy_from_slice(&data.bytes()[..len]);
            with_object(
                command | 0b11 | (4_u8.saturating_sub(len as u8) << 2),
                of,
                bytes,
            )
        }
        Short::Unsized(bytes) => with_object(command | 0b10, of, *bytes),
    }
}

fn sized(command: u8, of: Object, size: Option<u32>) -> Bytes {
    let has_size = u8::from(size.is_some());
    with_object(command | has_size, of, size.unwrap_or(0).to_le_bytes())
}

/// What follows a begin.
enum Begun {
    Data(Short),
    Size(Option<u32>),
}

fn begun(bytes: &Bytes) -> Begun {
    let (is_expedited, has_size) = (bytes[0] & 2 != 0, bytes[0] & 1 != 0);
    match (is_expedited, has_size) {
        (true, true) => {
            let unused = usize::from(bytes[0] >> 2 & 3);
            Begun::Data(Short::new(
                bytes
                    .get(4..8_usize.saturating_sub(unused))
                    .unwrap_or_default(),
            ))
        }
        (true, false) => Begun::Data(Short::Unsized([bytes[4], bytes[5], bytes[6], bytes[7]])),
        (false, true) => Begun::Size(Some(word(bytes))),
        (false, false) => Begun::Size(None),
    }
}

fn segment(toggle: bool, is_last: bool, data: &Chunk) -> Bytes {
    let unused = 7_u8.saturating_sub(data.len) << 1;
    let mut bytes = [0; 8];
    bytes[0] = u8::from(toggle) << 4 | unused | u8::from(is_last);
    bytes[1..].copy_from_slice(&data.bytes);
    bytes
}

fn of_segment(bytes: &Bytes) -> (bool, bool, Chunk) {
    let unused = usize::from(bytes[0] >> 1 & 7);
    let data = Chunk::new(
        bytes
            .get(1..8_usize.saturating_sub(unused))
            .unwrap_or_default(),
    );
    (is_toggled(bytes), bytes[0] & 1 != 0, data)
}

fn is_toggled(bytes: &Bytes) -> bool {
    bytes[0] & 0x10 != 0
}

impl Request {
    pub(crate) fn encode(&self) -> Bytes {
        match self {
            Request::Expedited { object, data } => expedited(0x20, *object, data),
            Request::Download { object, size } => sized(0x20, *object, *size),
            Request::DownloadSegment {
                toggle,
                is_last,
                data,
            } => segment(*toggle, *is_last, data),
            Request::Upload { object } => with_object(0x40, *object, [0; 4]),
            Request::UploadSegment { toggle } => {
                [0x60 | u8::from(*toggle) << 4, 0, 0, 0, 0, 0, 0, 0]
            }
            Request::Abort { object, code } => with_object(0x80, *object, code.0.to_le_bytes()),
        }
    }

    /// None for other commands: those of block transfers, say.
    pub(crate) fn decode(bytes: &Bytes) -> Option<Self> {
        let object = object(bytes);
        Some(match bytes[0] >> 5 {
            0 => {
                let (toggle, is_last, data) = of_segment(bytes);
                Request::DownloadSegment {
                    toggle,
                    is_last,
                    data,
                }
            }
            1 => match begun(bytes) {
                Begun::Data(data) => Request::Expedited { object, data },
                Begun::Size(size) => Request::Download { object, size },
            },
            2 => Request::Upload { object },
            3 => Request::UploadSegment {
                toggle: is_toggled(bytes),
            },
            4 => Request::Abort {
                object,
                code: AbortCode(word(bytes)),
            },
            _ => return None,
        })
    }
}

impl Response {
    pub(crate) fn encode(&self) -> Bytes {
        match self {
            Response::Segment {
                toggle,
                is_last,
                data,
            } => segment(*toggle, *is_last, data),
            Response::SegmentTaken { toggle } => {
                [0x20 | u8::from(*toggle) << 4, 0, 0, 0, 0, 0, 0, 0]
            }
            Response::Expedited { object, data } => expedited(0x40, *object, data),
            Response::Upload { object, size } => sized(0x40, *object, *size),
            Response::Downloaded { object } => with_object(0x60, *object, [0; 4]),
            Response::Abort { object, code } => with_object(0x80, *object, code.0.to_le_bytes()),
        }
    }

    /// None for other commands.
    pub(crate) fn decode(bytes: &Bytes) -> Option<Self> {
        let object = object(bytes);
        Some(match bytes[0] >> 5 {
            0 => {
                let (toggle, is_last, data) = of_segment(bytes);
                Response::Segment {
                    toggle,
                    is_last,
                    data,
                }
            }
            1 => Response::SegmentTaken {
                toggle: is_toggled(bytes),
            },
            2 => match begun(bytes) {
                Begun::Data(data) => Response::Expedited { object, data },
                Begun::Size(size) => Response::Upload { object, size },
            },
            3 => Response::Downloaded { object },
            4 => Response::Abort {
                object,
                code: AbortCode(word(bytes)),
            },
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn objects() -> impl Strategy<Value = Object> {
        (any::<u16>(), any::<u8>()).prop_map(|(index, sub)| Object::new(index, sub))
    }

    fn chunks(least: usize, most: usize) -> impl Strategy<Value = Chunk> {
        prop::collection::vec(any::<u8>(), least..=most).prop_map(|bytes| Chunk::new(&bytes))
    }

    fn shorts() -> impl Strategy<Value = Short> {
        prop_oneof![
            chunks(1, 4).prop_map(Short::Sized),
            any::<[u8; 4]>().prop_map(Short::Unsized),
        ]
    }

    fn codes() -> impl Strategy<Value = AbortCode> {
        any::<u32>().prop_map(AbortCode)
    }

    fn requests() -> impl Strategy<Value = Request> {
        let segment = (any::<bool>(), any::<bool>(), chunks(0, 7));
        prop_oneof![
            (objects(), shorts()).prop_map(|(object, data)| Request::Expedited { object, data }),
            (objects(), any::<Option<u32>>())
                .prop_map(|(object, size)| Request::Download { object, size }),
            segment.prop_map(|(toggle, is_last, data)| Request::DownloadSegment {
                toggle,
                is_last,
                data
            }),
            objects().prop_map(|object| Request::Upload { object }),
            any::<bool>().prop_map(|toggle| Request::UploadSegment { toggle }),
            (objects(), codes()).prop_map(|(object, code)| Request::Abort { object, code }),
        ]
    }

    fn responses() -> impl Strategy<Value = Response> {
        let segment = (any::<bool>(), any::<bool>(), chunks(0, 7));
        prop_oneof![
            objects().prop_map(|object| Response::Downloaded { object }),
            any::<bool>().prop_map(|toggle| Response::SegmentTaken { toggle }),
            (objects(), shorts()).prop_map(|(object, data)| Response::Expedited { object, data }),
            (objects(), any::<Option<u32>>())
                .prop_map(|(object, size)| Response::Upload { object, size }),
            segment.prop_map(|(toggle, is_last, data)| Response::Segment {
                toggle,
                is_last,
                data
            }),
            (objects(), codes()).prop_map(|(object, code)| Response::Abort { object, code }),
        ]
    }

    /// Bytes as the standard has them.
    #[test]
    fn known_messages() {
        let object = Object::new(0x1017, 0);
        let data = Short::new(&[0xE8, 3]);
        let write = Request::Expedited { object, data };
        assert_eq!(write.encode(), [0x2B, 0x17, 0x10, 0, 0xE8, 3, 0, 0]);
        let read = Request::Upload { object };
        assert_eq!(read.encode(), [0x40, 0x17, 0x10, 0, 0, 0, 0, 0]);
        let answer = Response::decode(&[0x4F, 0x17, 0x10, 0, 7, 9, 9, 9]);
        let data = Short::new(&[7]);
        assert_eq!(answer, Some(Response::Expedited { object, data }));
        let answer = Response::decode(&[0x42, 0x17, 0x10, 0, 7, 0, 0, 0]);
        let data = Short::Unsized([7, 0, 0, 0]);
        assert_eq!(answer, Some(Response::Expedited { object, data }));
        let long = Response::decode(&[0x41, 8, 0x10, 0, 26, 0, 0, 0]);
        let (object, size) = (Object::new(0x1008, 0), Some(26));
        assert_eq!(long, Some(Response::Upload { object, size }));
        let end = Response::decode(&[0x0D, 1, 0, 0, 0, 0, 0, 0]);
        let data = Chunk::new(&[1]);
        let (toggle, is_last) = (false, true);
        assert_eq!(
            end,
            Some(Response::Segment {
                toggle,
                is_last,
                data
            })
        );
        let abort = Response::decode(&[0x80, 0x17, 0x10, 0, 0, 0, 2, 6]);
        let (object, code) = (Object::new(0x1017, 0), AbortCode::NO_OBJECT);
        assert_eq!(abort, Some(Response::Abort { object, code }));
        assert_eq!(code.to_string(), "the object does not exist (06020000h)");
    }

    proptest! {
        #[test]
        fn requests_come_back(request in requests()) {
            prop_assert_eq!(Request::decode(&request.encode()), Some(request));
        }

        #[test]
        fn responses_come_back(response in responses()) {
            prop_assert_eq!(Response::decode(&response.encode()), Some(response));
        }

        #[test]
        fn any_bytes_are_decoded(bytes: [u8; 8]) {
            let _ = (Request::decode(&bytes), Response::decode(&bytes));
        }
    }
}
