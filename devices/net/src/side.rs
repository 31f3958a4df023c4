//! What the protocol keeps of a side.

use crate::age::Sent;
use crate::error::TypeInfo;
use crate::{NetError, Peer, Role};
use luna::Instant;
use luna::channel::ChannelEnd;
use std::collections::VecDeque;
use std::time::Duration;

/// Why a link ends.
#[derive(Debug)]
pub(crate) enum Stop {
    /// The local channel or the partner's has ended so.
    Ended(ChannelEnd),
    Failed(NetError),
}

/// What the link's process is to know.
#[derive(Debug)]
pub(crate) enum Event {
    Joined,
    Stop(Stop),
    /// The link's thread ends.
    Over,
}

/// What one message has led to.
pub(crate) type Events = [Option<Event>; 2];

/// An encoded value.
#[derive(Debug)]
pub(crate) struct Packet {
    pub(crate) buffer: Box<[u8]>,
    pub(crate) length: usize,
    pub(crate) sent: u64,
}

/// Takes values that have arrived. An error of decoding is a text.
pub(crate) type Deliver =
    Box<dyn FnMut(u64, Instant, Sent, &[u8]) -> Result<Accepted, String> + Send>;

/// Gives a buffer back to the link's process.
pub(crate) type GiveBack = Box<dyn FnMut(Box<[u8]>) + Send>;

/// Whether there was room for a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Accepted {
    Yes,
    Full,
}

/// What a side does with values.
pub(crate) enum Values {
    Out {
        /// Sent and not acknowledged, or still to be sent.
        queue: VecDeque<(u64, Packet)>,
        /// How many of them were sent.
        sent: usize,
        /// The number of the last one that was queued.
        last: u64,
        /// The partner's window.
        window: u64,
        give_back: GiveBack,
    },
    In {
        deliver: Deliver,
        arrived: u64,
        window: u64,
    },
}

impl Values {
    pub(crate) fn sending(
        buffers: usize,
        give_back: impl FnMut(Box<[u8]>) + Send + 'static,
    ) -> Self {
        Values::Out {
            queue: VecDeque::with_capacity(buffers),
            sent: 0,
            last: 0,
            window: 0,
            give_back: Box::new(give_back),
        }
    }

    pub(crate) fn receiving(
        window: u64,
        deliver: impl FnMut(u64, Instant, Sent, &[u8]) -> Result<Accepted, String> + Send + 'static,
    ) -> Self {
        Values::In {
            deliver: Box::new(deliver),
            arrived: 0,
            window,
        }
    }
}

pub(crate) struct Partner {
    pub(crate) number: u64,
    pub(crate) peer: Peer,
    pub(crate) session: u64,
    /// Number of the last value of earlier sessions.
    pub(crate) start: u64,
    pub(crate) heard: Instant,
    /// It says that this is its partner.
    pub(crate) is_joined: bool,
    /// What it has received; for a sender.
    pub(crate) arrived: u64,
    /// For how many ticks it has missed what was sent.
    pub(crate) behind: u32,
    pub(crate) end: Option<ChannelEnd>,
}

/// What a program keeps of a side's sessions.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Memory {
    /// Number of the last value that was sent, or taken.
    pub(crate) last: u64,
    /// Number of the last one that was acknowledged; none before the first session.
    pub(crate) acknowledged: Option<u64>,
    /// Number of the last session.
    pub(crate) session: u64,
}

/// What one side states of itself.
#[derive(Debug, Clone)]
pub(crate) struct Own {
    pub(crate) name: String,
    pub(crate) role: Role,
    pub(crate) number: u64,
    pub(crate) info: TypeInfo,
    pub(crate) peer: Peer,
    pub(crate) clock: u64,
    pub(crate) memory: Memory,
    pub(crate) lost_after: Duration,
}
