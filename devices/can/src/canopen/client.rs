//! The client of a node's SDO server.

use super::nmt::frame;
use super::sdo::{Chunk, Object, Request, Response};
use super::{AbortCode, NodeId, Value};
use crate::Frame;
use luna::{Error, Receiver, Sender};
use std::time::Duration;

/// Values are no longer than this unless [`SdoClient::longest`] says otherwise.
const LONGEST: usize = 64 * 1024;

/// Why an object was not read or written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SdoError {
    /// The node refuses.
    #[error("{node} aborts the transfer of {object}: {code}")]
    Aborted {
        /// Which node.
        node: NodeId,
        /// Which object.
        object: Object,
        /// Why.
        code: AbortCode,
    },
    /// The node did not answer in time. It was told that the transfer is aborted.
    #[error("{node} does not answer for {object} within {limit:?}")]
    TimedOut {
        /// Which node.
        node: NodeId,
        /// Which object.
        object: Object,
        /// How long was waited for one answer.
        limit: Duration,
    },
    /// The node answers what was not asked. It was told that the transfer is aborted, and why.
    #[error("{node} answers {object} against the protocol: {code}")]
    Protocol {
        /// Which node.
        node: NodeId,
        /// Which object.
        object: Object,
        /// What it was told.
        code: AbortCode,
    },
    /// The value has another length than its type.
    #[error("{object} of {node} has {len} bytes, but its type has {expected}")]
    Length {
        /// Which node.
        node: NodeId,
        /// Which object.
        object: Object,
        /// How many bytes came.
        len: usize,
        /// How many the type has.
        expected: usize,
    },
    /// The controller has ended.
    #[error("the CAN controller has ended")]
    Closed,
}

impl From<SdoError> for Error {
    fn from(error: SdoError) -> Self {
        Error::other(error)
    }
}

/// Reads and writes objects of one node: see [`Network::sdo`](super::Network::sdo).
///
/// One transfer at a time. Off the real-time path: it allocates, and a long value takes many
/// frames. Cancel-safe in so far as the next transfer is not confused; the node may have taken the
/// value.
#[derive(Debug)]
pub struct SdoClient {
    node: NodeId,
    requests: Sender<Frame>,
    responses: Receiver<Frame>,
    timeout: Duration,
    longest: usize,
}

impl SdoClient {
    pub(super) fn new(node: NodeId, requests: Sender<Frame>, responses: Receiver<Frame>) -> Self {
        Self {
            node,
            requests,
            responses,
            timeout: Duration::from_secs(1),
            longest: LONGEST,
        }
    }

    /// How long one answer may take; 1 s if not stated.
    #[must_use]
    pub fn timeout(mut self, timeout: Duration) -> Self {
        self.timeout = timeout;
        self
    }

    /// How many bytes a value that is read may have; 65 536 if not stated.
    #[must_use]
    pub fn longest(mut self, bytes: usize) -> Self {
        self.longest = bytes;
        self
    }

    /// Reads a value.
    ///
    /// # Errors
    ///
    /// An [`SdoError`].
    pub async fn read<T: Value>(&mut self, object: Object) -> Result<T, SdoError> {
        let bytes = self.upload(object).await?;
        T::decode(&bytes).ok_or(SdoError::Length {
            node: self.node,
            object,
            len: bytes.len(),
            expected: T::LEN,
        })
    }

    /// Writes a value.
    ///
    /// # Errors
    ///
    /// An [`SdoError`].
    pub async fn write<T: Value>(&mut self, object: Object, value: T) -> Result<(), SdoError> {
        let mut bytes = vec![0; T::LEN];
        value.encode(&mut bytes);
        self.download(object, &bytes).await
    }

    /// Reads the bytes of an object: by one frame, or in segments, as the node likes.
    ///
    /// # Errors
    ///
    /// An [`SdoError`].
    pub async fn upload(&mut self, object: Object) -> Result<Vec<u8>, SdoError> {
        let size = match self.ask(object, Request::Upload { object }).await? {
            Response::Expedited { object: of, data } if of == object => {
                return Ok(data.bytes().to_vec());
            }
            Response::Upload { object: of, size } if of == object => size,
            _ => return Err(self.abort(object, AbortCode::UNKNOWN_COMMAND).await),
        };
        let size = size.map(|size| size as usize);
        let limit = size.unwrap_or(self.longest);
        if limit > self.longest {
            return Err(self.abort(object, AbortCode::OUT_OF_MEMORY).await);
        }
        let mut bytes = Vec::with_capacity(limit.min(LONGEST));
        let mut toggle = false;
        loop {
            match self.ask(object, Request::UploadSegment { toggle }).await? {
                Response::Segment {
                    toggle: own,
                    is_last,
                    data,
                } if own == toggle => {
                    bytes.extend_from_slice(data.bytes());
                    if bytes.len() > limit {
                        return Err(self.abort(object, AbortCode::TOO_LONG).await);
                    }
                    if !is_last {
                        toggle = !toggle;
                        continue;
                    }
                    return match size {
                        Some(size) if size != bytes.len() => {
                            Err(self.abort(object, AbortCode::WRONG_LENGTH).await)
                        }
                        _ => Ok(bytes),
                    };
                }
                Response::Segment { .. } => {
                    return Err(self.abort(object, AbortCode::TOGGLE).await);
                }
                _ => return Err(self.abort(object, AbortCode::UNKNOWN_COMMAND).await),
            }
        }
    }

    /// Writes the bytes of an object: up to 4 by one frame, more in segments.
    ///
    /// # Errors
    ///
    /// An [`SdoError`].
    pub async fn download(&mut self, object: Object, bytes: &[u8]) -> Result<(), SdoError> {
        let is_expedited = (1..=4).contains(&bytes.len());
        let begin = match is_expedited {
            true => Request::Expedited {
                object,
                data: Chunk::new(bytes),
            },
            false => Request::Download {
                object,
                size: u32::try_from(bytes.len()).ok(),
            },
        };
        match self.ask(object, begin).await? {
            Response::Downloaded { object: of } if of == object => {}
            _ => return Err(self.abort(object, AbortCode::UNKNOWN_COMMAND).await),
        }
        if is_expedited {
            return Ok(());
        }
        let (mut toggle, mut rest) = (false, bytes);
        loop {
            let (now, later) = rest.split_at(rest.len().min(7));
            rest = later;
            let segment = Request::DownloadSegment {
                toggle,
                is_last: rest.is_empty(),
                data: Chunk::new(now),
            };
            match self.ask(object, segment).await? {
                Response::SegmentTaken { toggle: own } if own == toggle => {}
                Response::SegmentTaken { .. } => {
                    return Err(self.abort(object, AbortCode::TOGGLE).await);
                }
                _ => return Err(self.abort(object, AbortCode::UNKNOWN_COMMAND).await),
            }
            if rest.is_empty() {
                return Ok(());
            }
            toggle = !toggle;
        }
    }

    /// Sends a request, and waits for its answer.
    async fn ask(&mut self, object: Object, request: Request) -> Result<Response, SdoError> {
        // Late answers to what was given up.
        while self.responses.try_recv().is_ok() {}
        self.tell(request).await?;
        let answer = match self.responses.recv_timeout(self.timeout).await {
            Ok(answer) => answer,
            Err(error) if error.is_timeout() => {
                self.abort(object, AbortCode::TIMED_OUT).await;
                return Err(SdoError::TimedOut {
                    node: self.node,
                    object,
                    limit: self.timeout,
                });
            }
            Err(_) => return Err(SdoError::Closed),
        };
        let bytes = answer.data().try_into().ok();
        match bytes.and_then(Response::decode) {
            Some(Response::Abort { code, .. }) => Err(SdoError::Aborted {
                node: self.node,
                object,
                code,
            }),
            Some(response) => Ok(response),
            None => Err(self.abort(object, AbortCode::UNKNOWN_COMMAND).await),
        }
    }

    async fn tell(&self, request: Request) -> Result<(), SdoError> {
        let request = frame(self.node.sdo_request(), &request.encode());
        let sent = self.requests.send(request).await;
        sent.map_err(|_| SdoError::Closed)
    }

    /// Tells the node that the transfer has ended.
    async fn abort(&self, object: Object, code: AbortCode) -> SdoError {
        match self.tell(Request::Abort { object, code }).await {
            Ok(()) => SdoError::Protocol {
                node: self.node,
                object,
                code,
            },
            Err(error) => error,
        }
    }
}
