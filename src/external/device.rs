//! The file of a link: reads and writes that wait as processes do.
//!
//! Nearly the same as the `wire` of `luna-links`, which has a limit of time for writes in addition,
//! and no recording. They are two on purpose: this is the lowest crate that knows files that are
//! waited for, channel ends and their errors, so one for both would be a type of `luna`'s public
//! interface that no program has a use for, with both their differences as options.

use super::error::{LinkError, OsError};
use crate::replay::{self, Untaped};
use luna_channels::{ChannelEnd, Ended};
use luna_core::current;
use luna_core::replay_log::{Event, Turn};
use luna_executors::{FileError, readable, writable, yield_now};
use luna_platform::file;
use luna_platform::reactor::ReactorError;
use std::fs::File;
use std::future::{Future, poll_fn};
use std::io::{ErrorKind, IsTerminal};
use std::os::fd::OwnedFd;
use std::pin::{Pin, pin};
use std::task::Poll;

/// How many calls are made in one go to a file that never lets its link wait. Then others have
/// their turn.
const CALLS_IN_ONE_GO: u32 = 16;

/// An open file that lets its link wait: in non-blocking mode, or asked before each read whether
/// there is anything.
#[derive(Debug)]
pub(super) struct Device {
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
#[derive(Debug)]
pub(super) enum Stop {
    Failed(LinkError),
    /// The channel has ended, so there is no use in it.
    Ended(ChannelEnd),
}

impl From<LinkError> for Stop {
    fn from(error: LinkError) -> Self {
        Stop::Failed(error)
    }
}

impl Device {
    pub(super) fn new(file: OwnedFd) -> Self {
        let is_terminal = file.is_terminal();
        Self {
            file: file.into(),
            is_terminal,
            keeps_mode: false,
            calls: 0,
            is_drained: false,
            is_always_ready: false,
        }
    }

    /// As [`new`](Self::new), to be read alone: its mode stays as it is.
    pub(super) fn shared(file: OwnedFd) -> Self {
        Self {
            keeps_mode: true,
            ..Self::new(file)
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
    /// `ended`. 0 is the end of the file.
    pub(super) async fn read(
        &mut self,
        to: &mut [u8],
        ended: Pin<&mut Ended<'_>>,
    ) -> Result<usize, Stop> {
        if !current::has_replay_log() {
            return self.read_file(to, ended).await;
        }
        match replay::enters().await {
            Turn::Record => {
                let read = Untaped(self.read_file(to, ended)).await;
                match &read {
                    Ok(count) => replay::note_read(&to[..*count]),
                    Err(stop) => leave_by(stop),
                }
                read
            }
            Turn::Given(event) => {
                replay::leave(event);
                Err(stopped(event))
            }
            Turn::Look => match replay::read(to) {
                Some(count) => {
                    replay::hold().await;
                    Ok(count)
                }
                // The replay has ended.
                None => std::future::pending().await,
            },
        }
    }

    async fn read_file(
        &mut self,
        to: &mut [u8],
        mut ended: Pin<&mut Ended<'_>>,
    ) -> Result<usize, Stop> {
        loop {
            if self.is_drained {
                self.wait(Direction::In, ended.as_mut()).await?;
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
    /// `ended`.
    pub(super) async fn write(
        &mut self,
        bytes: &[u8],
        number: u64,
        ended: Pin<&mut Ended<'_>>,
    ) -> Result<(), Stop> {
        if !current::has_replay_log() {
            return self.write_file(bytes, number, ended).await;
        }
        replay::note_written(bytes);
        match replay::enters().await {
            Turn::Record => {
                let written = Untaped(self.write_file(bytes, number, ended)).await;
                match &written {
                    Ok(()) => replay::leave(Event::done(0)),
                    Err(stop) => leave_by(stop),
                }
                written
            }
            Turn::Given(event) => {
                replay::leave(event);
                Err(stopped(event))
            }
            Turn::Look => {
                replay::leave(Event::done(0));
                replay::hold().await;
                Ok(())
            }
        }
    }

    async fn write_file(
        &mut self,
        bytes: &[u8],
        number: u64,
        mut ended: Pin<&mut Ended<'_>>,
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
                    self.wait(Direction::Out, ended.as_mut()).await?;
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
    ) -> Result<(), Stop> {
        let mut ready = pin!(match direction {
            Direction::In => readable(&self.file),
            Direction::Out => writable(&self.file),
        });
        let waited = poll_fn(|cx| match ended.as_mut().poll(cx) {
            Poll::Ready(end) => Poll::Ready(Err(Stop::Ended(end))),
            Poll::Pending => ready.as_mut().poll(cx).map(Ok),
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
                return Err(Stop::Ended(end));
            }
        }
        Ok(())
    }
}

/// Records why a file was not read or written.
fn leave_by(stop: &Stop) {
    match stop {
        Stop::Ended(ChannelEnd::Closed) => replay::leave(Event::failed(0)),
        Stop::Ended(ChannelEnd::Poisoned) => replay::leave(Event::failed(1)),
        // An error of the system has too many forms.
        Stop::Failed(_) => {
            current::replay_log(|log| log.outside("a file of `luna::external` that fails"));
            replay::leave(Event::failed(0));
        }
    }
}

/// Why the recorded device was not read or written.
fn stopped(event: Event) -> Stop {
    Stop::Ended(match event.number {
        0 => ChannelEnd::Closed,
        _ => ChannelEnd::Poisoned,
    })
}

#[derive(Debug, Clone, Copy)]
enum Direction {
    In,
    Out,
}

/// The same on every Unix.
const EIO: i32 = 5;
