//! A file in non-blocking mode, read and written without blocking the executor.
//!
//! It resembles the `device` of `luna::external`, which documents why there are two. Check each for
//! defects found in the other.

use crate::end::Stop;
use luna::channel::Ended;
use luna::external::{FileError, readable, writable};
use luna::external::{LinkError, OsError};
use luna::{Instant, yield_now};
use luna_platform::file;
use luna_platform::reactor::ReactorError;
use std::fs::File;
use std::future::{Future, pending, poll_fn};
use std::io::{ErrorKind, IsTerminal};
use std::os::fd::OwnedFd;
use std::pin::{Pin, pin};
use std::task::Poll;
use std::time::Duration;

/// The limit of calls in one turn for a file that is always ready, so that other processes run.
const CALLS_IN_ONE_GO: u32 = 16;

#[derive(Debug)]
pub(crate) struct Wire {
    file: File,
    is_terminal: bool,
    /// Calls since the process last waited.
    calls: u32,
    /// Whether the last read took all there was, so that another read would find nothing.
    is_drained: bool,
    /// Whether it cannot be polled since it is always ready: `/dev/zero`, a file on a disk.
    is_always_ready: bool,
}

#[derive(Debug, Clone, Copy)]
enum Direction {
    In,
    Out,
}

impl Wire {
    /// Puts the file in non-blocking mode.
    pub(crate) fn new(file: OwnedFd) -> Result<Self, LinkError> {
        file::set_non_blocking(&file).map_err(|error| LinkError::SetUp(error.into()))?;
        Ok(Self {
            is_terminal: file.is_terminal(),
            file: file.into(),
            calls: 0,
            is_drained: false,
            is_always_ready: false,
        })
    }

    /// Reads into `to`, which is not empty; waits for data while the channel has not `ended`. 0:
    /// the other side has hung up, or an empty packet.
    pub(crate) async fn read(
        &mut self,
        to: &mut [u8],
        mut ended: Pin<&mut Ended<'_>>,
    ) -> Result<usize, Stop> {
        loop {
            if self.is_drained {
                self.wait(Direction::In, ended.as_mut(), None).await?;
            }
            self.give_way(ended.as_mut()).await?;
            match file::read(&self.file, to) {
                Ok(count) => {
                    self.is_drained = count < to.len() && !self.is_always_ready;
                    return Ok(count);
                }
                // Only for files that can be polled: otherwise this would loop for ever.
                Err(error) if error.kind() == ErrorKind::WouldBlock && !self.is_always_ready => {
                    self.is_drained = true;
                }
                // A terminal's error after the other side has hung up.
                Err(error) if self.is_terminal && error.raw_os_error() == Some(EIO) => {
                    return Ok(0);
                }
                Err(error) => return Err(LinkError::Read(error.into()).into()),
            }
        }
    }

    /// Writes all of `bytes`, the record `number`; waits for room while the channel has not
    /// `ended`, at most for `patience` at a time.
    pub(crate) async fn write(
        &mut self,
        bytes: &[u8],
        number: u64,
        mut ended: Pin<&mut Ended<'_>>,
        patience: Option<Duration>,
    ) -> Result<(), Stop> {
        let mut written = 0;
        let failed = |written, error: std::io::Error| {
            Err(Stop::Failed(LinkError::Write {
                record: number,
                written,
                error: OsError::from(error),
            }))
        };
        while written < bytes.len() {
            self.give_way(ended.as_mut()).await?;
            match file::write(&self.file, &bytes[written..]) {
                Ok(0) => return failed(written, ErrorKind::WriteZero.into()),
                Ok(count) => written += count,
                Err(error) if error.kind() == ErrorKind::WouldBlock && !self.is_always_ready => {
                    self.wait(Direction::Out, ended.as_mut(), patience).await?;
                }
                Err(error) => return failed(written, error),
            }
        }
        Ok(())
    }

    async fn wait(
        &mut self,
        direction: Direction,
        mut ended: Pin<&mut Ended<'_>>,
        patience: Option<Duration>,
    ) -> Result<(), Stop> {
        let mut ready = pin!(match direction {
            Direction::In => readable(&self.file),
            Direction::Out => writable(&self.file),
        });
        let mut time = pin!(until(patience.map(|patience| luna::now() + patience)));
        let waited = poll_fn(|cx| {
            if let Poll::Ready(end) = ended.as_mut().poll(cx) {
                return Poll::Ready(Err(Stop::from(end)));
            }
            if let Poll::Ready(waited) = ready.as_mut().poll(cx) {
                return Poll::Ready(Ok(waited));
            }
            let limit = patience.unwrap_or_default();
            let stalled = |()| Err(LinkError::Stalled { limit }.into());
            time.as_mut().poll(cx).map(stalled)
        })
        .await?;
        match waited {
            Ok(()) => {}
            Err(FileError::Refused(ReactorError::AlwaysReady { .. })) => {
                self.is_always_ready = true;
            }
            Err(error) => return Err(LinkError::Wait(error).into()),
        }
        self.is_drained = false;
        self.calls = 0;
        Ok(())
    }

    async fn give_way(&mut self, mut ended: Pin<&mut Ended<'_>>) -> Result<(), Stop> {
        self.calls += 1;
        if self.calls > CALLS_IN_ONE_GO {
            self.calls = 1;
            yield_now().await;
            let end = poll_fn(|cx| match ended.as_mut().poll(cx) {
                Poll::Ready(end) => Poll::Ready(Some(end)),
                Poll::Pending => Poll::Ready(None),
            });
            if let Some(end) = end.await {
                return Err(end.into());
            }
        }
        Ok(())
    }
}

/// Ends at an instant, if there is one.
async fn until(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => luna::at(deadline).await,
        None => pending().await,
    }
}

const EIO: i32 = 5;
