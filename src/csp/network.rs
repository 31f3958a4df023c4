//! The channels, barriers and locks of the program at one moment: who used which, and who waits.

use luna_channels::inspect::{self, PlaceKind, PlaceView};
use luna_platform::current::User;
use std::fmt;
use std::panic::Location;

pub(crate) use luna_channels::inspect::Role;

/// One who waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Waiting {
    pub(crate) user: User,
    pub(crate) role: Role,
}

/// A channel, a barrier or a lock.
#[derive(Debug, Clone)]
pub(crate) struct Meeting {
    pub(crate) kind: PlaceKind,
    pub(crate) name: Option<String>,
    pub(crate) made_at: &'static Location<'static>,
    pub(crate) buffered: usize,
    pub(crate) external: bool,
    pub(crate) ended: bool,
    /// Who last used each kind of end.
    pub(crate) sender: Option<User>,
    pub(crate) receiver: Option<User>,
    pub(crate) waiting: Vec<Waiting>,
}

impl Meeting {
    /// Whether `user` has used it last, or waits at it.
    pub(crate) fn concerns(&self, user: User) -> bool {
        self.sender == Some(user)
            || self.receiver == Some(user)
            || self.waiting.iter().any(|one| one.user == user)
    }

    /// Those who wait here and are `user`.
    pub(crate) fn waits_of(&self, user: User) -> impl Iterator<Item = Waiting> {
        self.waiting
            .iter()
            .copied()
            .filter(move |one| one.user == user)
    }
}

impl From<PlaceView> for Meeting {
    fn from(view: PlaceView) -> Self {
        let waiting = view.waiting.into_iter().map(|one| Waiting {
            user: one.user,
            role: one.role,
        });
        Self {
            kind: view.kind,
            name: view.name,
            made_at: view.made_at,
            buffered: view.buffered,
            external: view.external,
            ended: view.ended,
            sender: view.sender,
            receiver: view.receiver,
            waiting: waiting.collect(),
        }
    }
}

/// All that live in the program, in the order in which they were made. Not for the real-time path.
pub(crate) fn meetings() -> Vec<Meeting> {
    inspect::places().into_iter().map(Meeting::from).collect()
}

/// What a report calls it: its name, or where it was made.
impl fmt::Display for Meeting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.kind {
            PlaceKind::Barrier => "barrier",
            PlaceKind::Mutex => "mutex",
            PlaceKind::Condition => "condition",
            PlaceKind::Semaphore => "semaphore",
            _ => "channel",
        };
        match &self.name {
            Some(name) => write!(f, "{kind} `{name}`"),
            None => write!(f, "the {kind} made at {}", self.made_at),
        }
    }
}
