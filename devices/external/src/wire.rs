//! A file that lets its link wait: reads and writes that wait as processes do.
//!
//! The device of [`input`](super::input()) and [`output`](super::output()) records and replays what
//! passes through it; the links of `luna-links` do not.

use super::error::{LinkError, OsError};
use luna_channels::{ChannelEnd, Ended};
use luna_core::{FileError, readable, writable, yield_now};
use luna_machine::file;
use luna_platform::clock::Instant;
use luna_platform::reactor::ReactorError;
use std::fs::File;
use std::future::{Future, pending, poll_fn};
use std::io::{ErrorKind, IsTerminal};
use std::os::fd::OwnedFd;
use std::pin::{Pin, pin};
use std::task::Poll;
use std::time::Duration;

/// How many calls are made in one go to a file that never lets its link wait. Then others have
/// their turn.
const CALLS_IN_ONE_GO: u32 = 16;

/// An open file in non-blocking mode, or one that is asked before each read whether there is
/// anything.
#[doc(hidden)]
#[derive(Debug)]
pub struct Wire {
    file: File,
    is_terminal: bool,
    /// Whether its mode stays as it is: other programs have the same open file.
    keeps_mode: bool,
    /// Calls since the process last waited.
    calls: u32,
    /// Whether the last read took all bytes that were there, so that the next one would find none.
    is_drained: bool,
    /// Whether the system cannot wait for it, because it never has to be waited for: one on a disk,
    /// `/dev/zero`.
    is_always_ready: bool,
}

/// Why a read or write was not done.
#[doc(hidden)]
#[derive(Debug)]
pub enum WireStop {
    /// The file fails.
    Failed(LinkError),
    /// The channel has ended, so there is no use in it.
    Ended(ChannelEnd),
}

impl From<LinkError> for WireStop {
    fn from(error: LinkError) -> Self {
        WireStop::Failed(error)
    }
}

impl Wire {
    /// Puts the file in non-blocking mode.
    pub fn new(file: OwnedFd) -> Result<Self, LinkError> {
        let mut wire = Self::unprepared(file, false);
        wire.prepare()?;
        Ok(wire)
    }

    /// A file that is to be [prepared](Self::prepare). With `keeps_mode` it is to be read alone,
    /// and its mode stays as it is.
    pub(super) fn unprepared(file: OwnedFd, keeps_mode: bool) -> Self {
        Self {
            is_terminal: file.is_terminal(),
            file: file.into(),
            keeps_mode,
            calls: 0,
            is_drained: false,
            is_always_ready: false,
        }
    }

    pub(super) fn prepare(&mut self) -> Result<(), LinkError> {
        self.is_always_ready = self.file.metadata().is_ok_and(|about| about.is_file());
        self.is_drained = self.keeps_mode && !self.is_always_ready;
        if self.keeps_mode {
            return Ok(());
        }
        file::set_non_blocking(&self.file).map_err(|error| LinkError::SetUp(error.into()))
    }

    /// Reads what is there, to a place that is not empty; waits for some, while the channel has not
    /// `ended`. 0 is the end of the file, or an empty packet.
    pub async fn read(
        &mut self,
        to: &mut [u8],
        mut ended: Pin<&mut Ended<'_>>,
    ) -> Result<usize, WireStop> {
        loop {
            if self.is_drained {
                self.wait(Direction::In, ended.as_mut(), None).await?;
            }
            self.give_way(ended.as_mut()).await?;
            match file::read(&self.file, to) {
                Ok(count) => {
                    let may_be_empty = count < to.len() || self.keeps_mode;
                    self.is_drained = may_be_empty && !self.is_always_ready;
                    return Ok(count);
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    self.is_drained = true;
                    // A file that counts as always ready but is not would be polled for ever.
                    if self.is_always_ready {
                        return Err(LinkError::Read(error.into()).into());
                    }
                }
                // A terminal reports this when its other side has hung up.
                Err(error) if self.is_terminal && error.raw_os_error() == Some(EIO) => {
                    return Ok(0);
                }
                Err(error) => return Err(LinkError::Read(error.into()).into()),
            }
        }
    }

    /// Writes all of `bytes`, the record `number`; waits for room, while the channel has not
    /// `ended`, at most for `patience` at a time.
    pub async fn write(
        &mut self,
        bytes: &[u8],
        number: u64,
        mut ended: Pin<&mut Ended<'_>>,
        patience: Option<Duration>,
    ) -> Result<(), WireStop> {
        let mut written = 0;
        let failed = |written, error: std::io::Error| {
            Err(WireStop::Failed(LinkError::Write {
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
    ) -> Result<(), WireStop> {
        let mut ready = pin!(match direction {
            Direction::In => readable(&self.file),
            Direction::Out => writable(&self.file),
        });
        let mut time = pin!(until(
            patience.map(|patience| luna_replay::now() + patience)
        ));
        let waited = poll_fn(|cx| {
            if let Poll::Ready(end) = ended.as_mut().poll(cx) {
                return Poll::Ready(Err(WireStop::Ended(end)));
            }
            if let Poll::Ready(waited) = ready.as_mut().poll(cx) {
                return Poll::Ready(Ok(waited));
            }
            let limit = patience.unwrap_or_default();
            let stalled = |()| Err(LinkError::Stalled { limit }.into());
            time.as_mut().poll(cx).map(stalled)
        })
        .await?;
        self.is_drained = false;
        match waited {
            Ok(()) => {
                self.calls = 0;
                Ok(())
            }
            Err(FileError::Refused(ReactorError::AlwaysReady { .. })) => {
                self.is_always_ready = true;
                Ok(())
            }
            Err(error) => Err(LinkError::Wait(error).into()),
        }
    }

    async fn give_way(&mut self, mut ended: Pin<&mut Ended<'_>>) -> Result<(), WireStop> {
        self.calls += 1;
        if self.calls > CALLS_IN_ONE_GO {
            self.calls = 1;
            yield_now().await;
            let end = poll_fn(|cx| match ended.as_mut().poll(cx) {
                Poll::Ready(end) => Poll::Ready(Some(end)),
                Poll::Pending => Poll::Ready(None),
            });
            if let Some(end) = end.await {
                return Err(WireStop::Ended(end));
            }
        }
        Ok(())
    }
}

/// Ends at an instant, if there is one.
async fn until(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => luna_channels::at(deadline).await,
        None => pending().await,
    }
}

#[derive(Debug, Clone, Copy)]
enum Direction {
    In,
    Out,
}

/// The same on every Unix.
const EIO: i32 = 5;
