//! What a controller needs of a bus, whichever it is.

use crate::{Filter, Frame};
use luna::external::{FileError, OsError};
use std::fmt;
use std::future::Future;

/// The access of one node to a bus: a kernel's interface ([`Socket`](crate::Socket)), a simulated
/// one ([`sim::Port`](crate::sim::Port)), or one of your own.
///
/// A [`Controller`](crate::Controller) calls `transmit` and `receive` at once, each from one place.
/// On the real-time path neither allocates.
pub trait Port: Send + Sync + 'static {
    /// Whether frames come from outside of the system. Then no process that waits for one is part
    /// of a deadlock.
    const IS_OUTSIDE: bool;

    /// Waits until there is room for a frame, and sends it. Cancel-safe: the frame was sent whole,
    /// or not.
    fn transmit(&self, frame: Frame) -> impl Future<Output = Result<(), PortError>> + Send;

    /// Waits for what comes. Cancel-safe: nothing is lost.
    fn receive(&self) -> impl Future<Output = Result<Incoming, PortError>> + Send;

    /// Says which frames are of interest, once, before any is received. A port may give others too.
    ///
    /// # Errors
    ///
    /// The system's error.
    fn listen(&self, filters: &[Filter]) -> Result<(), PortError>;

    /// Sends a frame without waiting, for an emergency; before those that wait, if it can.
    ///
    /// # Errors
    ///
    /// There is no room, or the port fails.
    fn transmit_at_once(&self, frame: Frame) -> Result<(), PortError>;
}

/// What comes from a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Incoming {
    /// A frame of another node.
    Frame(Frame),
    /// What the node's controller reports.
    Report(BusReport),
}

/// What a node's controller reports of the bus, in one go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct BusReport {
    /// The error state that it has now, if that has changed.
    pub state: Option<State>,
    /// How many frames were lost, since a queue was full.
    pub lost: u64,
    /// What it has seen.
    pub error: Option<BusError>,
}

impl BusReport {
    /// A report of these three.
    pub fn new(state: Option<State>, lost: u64, error: Option<BusError>) -> Self {
        Self { state, lost, error }
    }
}

/// The error state of a node, by its error counters. A frame that it sends and that is destroyed
/// adds 8 to one, most errors in frames of others add 1, and each good frame takes 1 away.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, PartialOrd, Ord)]
#[non_exhaustive]
pub enum State {
    /// Both counters are below 96.
    #[default]
    Active,
    /// A counter is 96 or more.
    Warning,
    /// A counter is 128 or more: it can no longer destroy the frames of others.
    Passive,
    /// The counter of what it sends is above 255: it takes no part until it is restarted.
    BusOff,
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            State::Active => "error active",
            State::Warning => "error warning",
            State::Passive => "error passive",
            State::BusOff => "bus-off",
        })
    }
}

/// What went wrong on the bus. The controller repeats a frame by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, thiserror::Error)]
#[non_exhaustive]
pub enum BusError {
    /// No node has acknowledged a frame.
    #[error(
        "no node has acknowledged a frame: check that another is on the bus, the wires and the bit rates"
    )]
    NotAcknowledged,
    /// A frame was destroyed: a bit, its stuffing, its form or its checksum is wrong.
    #[error("a frame was destroyed: check the wires, the termination and the bit rates")]
    Protocol,
    /// The transceiver reports a broken wire or a short.
    #[error("the transceiver reports a broken wire or a short circuit")]
    Transceiver,
    /// A frame did not get out in the driver's time.
    #[error("a frame did not get out in time")]
    TransmitTimeout,
    /// Something else.
    #[error("a bus error without details")]
    Other,
}

/// Why a port cannot go on.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PortError {
    /// The interface is down.
    #[error("the interface is down: `ip link set NAME up`")]
    Down,
    /// The interface, or the simulated bus, is gone.
    #[error("the CAN interface is gone")]
    Gone,
    /// There is no room for a frame that cannot wait.
    #[error("there is no room for a frame at once")]
    Full,
    /// The system's error.
    #[error("the CAN interface fails: {0}")]
    Failed(OsError),
    /// The interface cannot be waited for.
    #[error("{0}")]
    Wait(#[source] FileError),
}
