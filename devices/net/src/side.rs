//! What the protocol keeps of a side.

use crate::error::TypeInfo;
use crate::inbox::Inbox;
use crate::outbox::Outbox;
use crate::{NetError, Peer, Role};
use luna::Instant;
use luna::channel::ChannelEnd;
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
    /// So many values may be under way.
    Joined {
        window: u64,
    },
    Stop(Stop),
    /// The link's thread ends.
    Over,
}

/// What one message has led to.
pub(crate) type Events = [Option<Event>; 2];

/// What a side does with values.
pub(crate) enum Values {
    Out(Outbox),
    In {
        inbox: Box<dyn Inbox>,
        /// The number of the last value that has arrived.
        arrived: u64,
    },
}

impl Values {
    pub(crate) fn receiving(inbox: Box<dyn Inbox>) -> Self {
        Values::In { inbox, arrived: 0 }
    }
}

pub(crate) struct Partner {
    pub(crate) number: u64,
    pub(crate) peer: Peer,
    pub(crate) session: u64,
    /// Number of the last value of earlier sessions.
    pub(crate) start: u64,
    /// How many values may be under way: the smaller of both sides' windows.
    pub(crate) window: u64,
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
    /// How many values may be under way from or to this side.
    pub(crate) window: u64,
    pub(crate) lost_after: Duration,
}
