//! Where processes meet: the part of a channel or barrier that does not depend on the type of what is communicated.

use crate::inspect::Identity;
use luna_platform::current::{Heir, ProcessId, User};
use luna_platform::lock::{PiGuard, PiLock};
use luna_platform::wait_list::WaitList;

/// Whether more can be communicated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ending {
    Open,
    /// All senders are gone, or all receivers.
    Closed,
    Poisoned,
}

/// What a place's lock guards. The nodes in the lists are guarded with it.
#[derive(Debug)]
pub struct Lists {
    pub(crate) senders: WaitList,
    pub(crate) receivers: WaitList,
    /// Senders whose value was received by extended rendezvous, and which are held until the receiver is done with it.
    pub(crate) held: WaitList,
    /// Alternatives that stay registered between their selections, as receivers.
    pub(crate) registered: WaitList,
    /// Those who wait for the end alone: see `ended`.
    pub(crate) watching: WaitList,
    pub(crate) ending: Ending,
    /// Whether anybody has ever waited to receive by extended rendezvous.
    pub(crate) extends: bool,
    /// The number of extended rendezvous so far: it tells a held sender from another one at the same address.
    pub(crate) tickets: u32,
    /// Who last used each kind of end.
    pub(crate) sender: LastUser,
    pub(crate) receiver: LastUser,
    /// Who last came to accept a call here, lent the priority of the most urgent client that waits. `None` once the place has ended.
    pub(crate) server: Option<Heir>,
}

/// Who last used one kind of ends, if anybody has: an `Option<User>` that is one store.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LastUser(u32);

impl LastUser {
    pub(crate) const NOBODY: LastUser = LastUser(u32::MAX);

    #[inline]
    pub(crate) fn of(user: User) -> Self {
        LastUser(match user {
            User::Outside => 0,
            User::Process(process) => process.get(),
        })
    }

    pub(crate) fn get(self) -> Option<User> {
        match self.0 {
            u32::MAX => None,
            number => Some(ProcessId::from_number(number).map_or(User::Outside, User::Process)),
        }
    }
}

/// Where processes meet.
#[derive(Debug)]
pub struct Place {
    lock: PiLock<Lists>,
    pub(crate) identity: Identity,
}

impl Place {
    pub(crate) fn new(identity: Identity) -> Self {
        Self {
            lock: PiLock::new(Lists {
                senders: WaitList::new(),
                receivers: WaitList::new(),
                held: WaitList::new(),
                registered: WaitList::new(),
                watching: WaitList::new(),
                ending: Ending::Open,
                extends: false,
                tickets: 0,
                sender: LastUser::NOBODY,
                receiver: LastUser::NOBODY,
                server: None,
            }),
            identity,
        }
    }

    #[inline]
    pub(crate) fn lock(&self) -> PiGuard<'_, Lists> {
        self.lock.lock()
    }
}
