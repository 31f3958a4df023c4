//! The client of a node's SDO server.

use super::nmt::frame;
use super::sdo::{Chunk, Request, Response, Short};
use super::{AbortCode, NodeId, Object, Value};
use crate::Frame;
use luna::{Error, Receiver, Sender};
use std::time::Duration;

/// Values are no longer than this unless [`SdoClient::longest`] says otherwise.
const LONGEST: usize = 64 * 1024;

/// What an abort is for that is for no object.
const NO_OBJECT: Object = Object::new(0, 0);

/// Why an object was not read or written, or a node has no client.
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
    /// No answer came in time: the node gave none, or the bus took no request. A node that was
    /// asked is told that the transfer is aborted.
    #[error("no answer of {node} for {object} within {limit:?}")]
    TimedOut {
        /// Which node.
        node: NodeId,
        /// Which object.
        object: Object,
        /// How long was waited to send one request and for its answer.
        limit: Duration,
    },
    /// The node answers what was not asked. The client aborts the transfer with this code.
    #[error("{node} answers {object} against the protocol: {code}")]
    Protocol {
        /// Which node.
        node: NodeId,
        /// Which object.
        object: Object,
        /// Why the client aborts.
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
    /// The network has an SDO client for this node already.
    #[error("the network has an SDO client for {node} already: use that one")]
    HasClient {
        /// Which node.
        node: NodeId,
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
/// frames.
///
/// After a transfer that timed out or was dropped the node may have taken the value. An answer says
/// which object it is for, but not which request. So the next transfer begins only after another
/// [`timeout`](Self::timeout), and answers that come until then are dropped. An answer that comes
/// later still, for the same object, looks like a new one. Let the timeout be longer than the node
/// takes.
///
/// To send the abort of a transfer may take another timeout at most. If the bus takes no frame
/// until then, the abort is not sent.
#[derive(Debug)]
pub struct SdoClient {
    node: NodeId,
    requests: Sender<Frame>,
    responses: Receiver<Frame>,
    timeout: Duration,
    longest: usize,
    /// Whether a request has had no answer yet.
    is_asked: bool,
}

impl SdoClient {
    pub(super) fn new(node: NodeId, requests: Sender<Frame>, responses: Receiver<Frame>) -> Self {
        Self {
            node,
            requests,
            responses,
            timeout: Duration::from_secs(1),
            longest: LONGEST,
            is_asked: false,
        }
    }

    /// How long it may take to send one request and have its answer; 1 s if not stated. A long
    /// value takes many requests.
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

    /// Reads a value. If the node does not state how many bytes it has, as many are taken as its
    /// type has.
    ///
    /// # Errors
    ///
    /// An [`SdoError`].
    pub async fn read<T: Value>(&mut self, object: Object) -> Result<T, SdoError> {
        let bytes = self.upload_of_len(object, T::LEN).await?;
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

    /// Reads the bytes of an object: by one frame, or in segments, as the node likes. If the node
    /// answers by one frame and does not state how many of its 4 bytes count, it gives all 4.
    ///
    /// # Errors
    ///
    /// An [`SdoError`].
    pub async fn upload(&mut self, object: Object) -> Result<Vec<u8>, SdoError> {
        self.upload_of_len(object, 4).await
    }

    /// `len` counts where the node does not state it.
    async fn upload_of_len(&mut self, object: Object, len: usize) -> Result<Vec<u8>, SdoError> {
        let size = match self.begin(object, Request::Upload { object }).await? {
            Response::Expedited { object: of, data } if of == object => {
                return Ok(data.of_len(len).to_vec());
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
                    // Else it could go on for ever.
                    if data.bytes().is_empty() && !is_last {
                        return Err(self.abort(object, AbortCode::UNKNOWN_COMMAND).await);
                    }
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
                data: Short::new(bytes),
            },
            false => Request::Download {
                object,
                size: u32::try_from(bytes.len()).ok(),
            },
        };
        match self.begin(object, begin).await? {
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

    /// Begins a transfer.
    async fn begin(&mut self, object: Object, request: Request) -> Result<Response, SdoError> {
        if self.is_asked {
            luna::after(self.timeout).await;
        }
        self.ask(object, request).await
    }

    /// Sends a request, and waits for its answer.
    async fn ask(&mut self, object: Object, request: Request) -> Result<Response, SdoError> {
        // Late answers to what was given up.
        while self.responses.try_recv().is_ok() {}
        let timed_out = SdoError::TimedOut {
            node: self.node,
            object,
            limit: self.timeout,
        };
        let deadline = luna::now() + self.timeout;
        let sent = self.requests.send_deadline(self.frame(request), deadline);
        match sent.await {
            Ok(()) => self.is_asked = true,
            Err(error) if error.is_timeout() => return Err(timed_out),
            Err(_) => return Err(SdoError::Closed),
        }
        loop {
            let answer = match self.responses.recv_deadline(deadline).await {
                Ok(answer) => answer,
                Err(error) if error.is_timeout() => {
                    self.abort(object, AbortCode::TIMED_OUT).await;
                    return Err(timed_out);
                }
                Err(_) => return Err(SdoError::Closed),
            };
            // A message of SDO has 8 bytes: another frame is none, whoever sent it.
            let Ok(bytes) = answer.data().try_into() else {
                continue;
            };
            let answered = match Response::decode(bytes) {
                // That of a transfer that was given up. Servers abort requests that they do not
                // know with no object.
                Some(Response::Abort { object: of, .. }) if of != object && of != NO_OBJECT => {
                    continue;
                }
                Some(Response::Abort { code, .. }) => Err(SdoError::Aborted {
                    node: self.node,
                    object,
                    code,
                }),
                Some(response) => Ok(response),
                None => Err(self.abort(object, AbortCode::UNKNOWN_COMMAND).await),
            };
            self.is_asked = false;
            return answered;
        }
    }

    fn frame(&self, request: Request) -> Frame {
        frame(self.node.sdo_request(), &request.encode())
    }

    /// Tells the node that the transfer has ended.
    async fn abort(&self, object: Object, code: AbortCode) -> SdoError {
        let request = self.frame(Request::Abort { object, code });
        match self.requests.send_timeout(request, self.timeout).await {
            Err(error) if !error.is_timeout() => SdoError::Closed,
            _ => SdoError::Protocol {
                node: self.node,
                object,
                code,
            },
        }
    }
}
