//! How a link ends.

use luna::channel::ChannelEnd;
use luna::devices::Device;
use luna::external::{BadRecord, LinkError, WireStop};
use luna::{Error, RecvError, SendError};
use std::convert::Infallible;
use std::time::Duration;

/// What a loop returns that only a [`Stop`] ends.
pub(crate) type UntilStopped = Result<Infallible, Stop>;

/// Why a link stops.
#[derive(Debug)]
pub(crate) enum Stop {
    /// The other ends of its channel are gone.
    Closed,
    /// Its channel was poisoned.
    Poisoned,
    /// The other side of the transport has closed it.
    HungUp,
    /// A record cannot be read or written.
    Record(BadRecord),
    /// The transport fails.
    Failed(LinkError),
}

impl From<LinkError> for Stop {
    fn from(error: LinkError) -> Self {
        Stop::Failed(error)
    }
}

impl From<WireStop> for Stop {
    fn from(stop: WireStop) -> Self {
        match stop {
            WireStop::Failed(error) => Stop::Failed(error),
            WireStop::Ended(end) => end.into(),
        }
    }
}

impl From<BadRecord> for Stop {
    fn from(bad: BadRecord) -> Self {
        Stop::Record(bad)
    }
}

impl<T> From<SendError<T>> for Stop {
    fn from(error: SendError<T>) -> Self {
        match error.is_closed() {
            true => Stop::Closed,
            false => Stop::Poisoned,
        }
    }
}

impl From<RecvError> for Stop {
    fn from(error: RecvError) -> Self {
        match error.is_closed() {
            true => Stop::Closed,
            false => Stop::Poisoned,
        }
    }
}

impl From<ChannelEnd> for Stop {
    fn from(end: ChannelEnd) -> Self {
        match end {
            ChannelEnd::Closed => Stop::Closed,
            ChannelEnd::Poisoned => Stop::Poisoned,
        }
    }
}

impl Stop {
    /// What the link's process ends with.
    pub(crate) fn end(self, device: &dyn Lose) -> luna::Result<()> {
        Err(match self {
            Stop::Closed => return Ok(()),
            Stop::Poisoned => Error::Poisoned,
            Stop::Record(bad) => LinkError::Record(bad).into(),
            Stop::HungUp => device.lost(LinkError::HungUp.into()),
            Stop::Failed(error) => device.lost(error.into()),
        })
    }
}

/// A device of whatever type, as a link sees it.
pub(crate) trait Lose: Send {
    /// As [`Device::lost`].
    fn lost(&self, error: Error) -> Error;

    /// As [`Device::on_emergency_within`], for a function without access to the device.
    fn on_emergency(
        &self,
        what: &str,
        limit: Duration,
        function: Box<dyn FnMut() + Send>,
    ) -> luna::Result<()>;
}

impl<D: Send + Sync + 'static> Lose for Device<D> {
    fn lost(&self, error: Error) -> Error {
        Device::lost(self, error)
    }

    fn on_emergency(
        &self,
        what: &str,
        limit: Duration,
        mut function: Box<dyn FnMut() + Send>,
    ) -> luna::Result<()> {
        self.on_emergency_within(what, limit, move |_| function())
    }
}
