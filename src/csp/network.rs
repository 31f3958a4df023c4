//! The channels, barriers and locks of the program at one moment: the users of each, and the
//! waiters.

use luna_channels::inspect::{self, WaitPointKind, WaitPointView};
use luna_core::current::{ProcessId, User};
use std::fmt;
use std::panic::Location;

pub(crate) use luna_channels::inspect::Role;

/// One waiter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Waiting {
    pub(crate) user: User,
    pub(crate) role: Role,
}

/// A channel, a barrier or a lock.
#[derive(Debug, Clone)]
pub(crate) struct Meeting {
    pub(crate) kind: WaitPointKind,
    /// What its ends have in them.
    pub(crate) address: usize,
    pub(crate) name: Option<String>,
    pub(crate) made_at: &'static Location<'static>,
    pub(crate) buffered: usize,
    pub(crate) external: bool,
    /// Whether a party of a barrier is unknown to any system.
    pub(crate) strangers: bool,
    pub(crate) ended: bool,
    /// The last user of each kind of end.
    pub(crate) sender: Option<User>,
    pub(crate) receiver: Option<User>,
    pub(crate) waiting: Vec<Waiting>,
}

impl Meeting {
    /// The processes that have used it last, or wait at it; perhaps several times.
    pub(crate) fn users(&self) -> impl Iterator<Item = ProcessId> {
        let last = self.sender.into_iter().chain(self.receiver);
        let all = last.chain(self.waiting.iter().map(|one| one.user));
        all.filter_map(|user| match user {
            User::Process(id) => Some(id),
            User::Outside => None,
        })
    }
}

impl From<WaitPointView> for Meeting {
    fn from(view: WaitPointView) -> Self {
        let waiting = view.waiting.into_iter().map(|one| Waiting {
            user: one.user,
            role: one.role,
        });
        Self {
            kind: view.kind,
            address: view.address,
            name: view.name,
            made_at: view.made_at,
            buffered: view.buffered,
            external: view.external,
            strangers: view.strangers,
            ended: view.ended,
            sender: view.sender,
            receiver: view.receiver,
            waiting: waiting.collect(),
        }
    }
}

/// All that live in the program, in the order in which they were made. Not for the real-time path.
pub(crate) fn meetings() -> Vec<Meeting> {
    inspect::wait_points()
        .into_iter()
        .map(Meeting::from)
        .collect()
}

/// What a report calls it: its name, or where it was made.
impl fmt::Display for Meeting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.kind {
            WaitPointKind::Barrier => "barrier",
            WaitPointKind::Mutex => "mutex",
            WaitPointKind::Condition => "condition",
            WaitPointKind::Semaphore => "semaphore",
            _ => "channel",
        };
        match &self.name {
            Some(name) => write!(f, "{kind} `{name}`"),
            None => write!(f, "the {kind} made at {}", self.made_at),
        }
    }
}
