//! One connection: a request, and its answer.

use crate::frame::{Answer, Frame, HEADER};
use crate::{Counts, Garbage, Request, RequestError};
use luna::Instant;
use luna::external::{FileError, readable, writable};
use luna::realtime::off_path;
use std::future::{Future, poll_fn};
use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::pin::pin;
use std::task::Poll;
use std::time::Duration;

/// A frame is no longer.
const LONGEST: usize = 260;

pub(crate) struct Connection {
    stream: TcpStream,
    answer: [u8; LONGEST],
}

/// Why an exchange stops; the request is added to it.
enum Stop {
    TimedOut,
    HungUp,
    Garbage(Garbage),
    Failed(io::Error),
    Wait(FileError),
}

impl From<io::Error> for Stop {
    fn from(error: io::Error) -> Self {
        Stop::Failed(error)
    }
}

fn failed(request: Request, error: io::Error) -> RequestError {
    match error.kind() {
        ErrorKind::BrokenPipe | ErrorKind::ConnectionReset => RequestError::HungUp { request },
        _ => RequestError::Failed {
            request,
            error: error.into(),
        },
    }
}

impl Connection {
    pub(crate) fn new(stream: TcpStream) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        Ok(Self {
            stream,
            answer: [0; LONGEST],
        })
    }

    /// Sends the request and waits for its answer, no longer than `limit`. The values of a read are
    /// appended to `values`.
    pub(crate) async fn exchange(
        &mut self,
        frame: &Frame,
        limit: Duration,
        values: &mut Vec<u16>,
        counts: &Counts,
    ) -> Result<(), RequestError> {
        let request = frame.about;
        let answered = self.talk(frame, luna::now() + limit, counts).await;
        let judged = answered.and_then(|len| {
            frame
                .judge(&mut self.answer[..len], values)
                .map_err(Stop::Garbage)
        });
        Err(match judged {
            Ok(Answer::Good) => return Ok(()),
            Ok(Answer::Refused(code)) => RequestError::Exception { request, code },
            Err(Stop::TimedOut) => RequestError::TimedOut { request, limit },
            Err(Stop::HungUp) => RequestError::HungUp { request },
            Err(Stop::Garbage(why)) => RequestError::Garbage { request, why },
            Err(Stop::Failed(error)) => failed(request, error),
            Err(Stop::Wait(error)) => RequestError::Wait { request, error },
        })
    }

    /// Finds that the server has closed the connection, before a request is sent. What else came
    /// is left to the next exchange.
    pub(crate) fn check(&self, request: Request) -> Result<(), RequestError> {
        match off_path(|| self.stream.peek(&mut [0])) {
            Ok(0) => Err(RequestError::HungUp { request }),
            Ok(_) => Ok(()),
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::Interrupted => Ok(()),
                _ => Err(failed(request, error)),
            },
        }
    }

    /// Returns the length of the answer.
    async fn talk(
        &mut self,
        frame: &Frame,
        deadline: Instant,
        counts: &Counts,
    ) -> Result<usize, Stop> {
        let (bytes, mut sent) = (&frame.bytes, 0);
        while sent < bytes.len() {
            match off_path(|| (&self.stream).write(&bytes[sent..])) {
                Ok(count) => sent += count,
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    by(deadline, writable(&self.stream)).await?;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
        loop {
            self.fill(0, HEADER, deadline).await?;
            let len = Frame::answer_len(&self.answer[..HEADER]).map_err(Stop::Garbage)?;
            self.fill(HEADER, len, deadline).await?;
            if frame.is_answered_by(&self.answer[..HEADER]) {
                return Ok(len);
            }
            counts.add_stray();
            // A server that sends one after the other holds up no other process.
            luna::yield_now().await;
            if luna::now() >= deadline {
                return Err(Stop::TimedOut);
            }
        }
    }

    async fn fill(&mut self, from: usize, to: usize, deadline: Instant) -> Result<(), Stop> {
        let mut filled = from;
        while filled < to {
            match off_path(|| (&self.stream).read(&mut self.answer[filled..to])) {
                Ok(0) => return Err(Stop::HungUp),
                Ok(count) => filled += count,
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    by(deadline, readable(&self.stream)).await?;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }
}

/// Waits until the file is ready, or the deadline.
async fn by(
    deadline: Instant,
    ready: impl Future<Output = Result<(), FileError>>,
) -> Result<(), Stop> {
    let mut ready = pin!(ready);
    let mut late = pin!(luna::at(deadline));
    poll_fn(|cx| {
        if let Poll::Ready(waited) = ready.as_mut().poll(cx) {
            return Poll::Ready(waited.map_err(Stop::Wait));
        }
        late.as_mut().poll(cx).map(|()| Err(Stop::TimedOut))
    })
    .await
}
