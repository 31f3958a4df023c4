//! The channel at which the current process' operation failed last: its process may end for that,
//! and the channel is gone by then.

use super::{Identity, Nth};
use crate::wait_point::WaitPoint;
use alloc::format;
use alloc::string::String;
use core::cell::Cell;
use core::fmt;
use core::panic::Location;
use luna_core::current::{self, User};

/// A channel that an operation found closed or poisoned.
///
/// Its `Display` has the channel and its place: "channel `pressure`, made at src/main.rs:12".
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct FailedAt {
    /// The process or thread whose operation failed.
    pub user: User,
    /// Whether it sent; else it received.
    pub sends: bool,
    /// Whether the channel was poisoned; else the other ends are gone.
    pub poisoned: bool,
    /// Where in the program the channel was made.
    pub made_at: &'static Location<'static>,
    /// The process or thread that used the other side last, if there was one.
    pub partner: Option<User>,
    nth: u16,
    name: Name,
}

impl FailedAt {
    /// Where the channel was made, and which of those that were made there it is.
    pub fn place(&self) -> String {
        let (file, line) = (self.made_at.file(), self.made_at.line());
        format!("{file}:{line}{}", Nth(self.nth))
    }

    /// The channel's name, if it was given one; of a long one its beginning.
    pub fn name(&self) -> Option<&str> {
        self.name.get()
    }
}

impl fmt::Display for FailedAt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.name() {
            Some(name) => write!(f, "channel `{name}`, made at ")?,
            None => f.write_str("the channel made at ")?,
        }
        let (file, line) = (self.made_at.file(), self.made_at.line());
        write!(f, "{file}:{line}{}", Nth(self.nth))
    }
}

/// A copy of a channel's name without allocation: the note is made on the real-time path.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Name {
    length: u8,
    bytes: [u8; 47],
}

impl Name {
    fn of(identity: &Identity) -> Self {
        let mut copy = Self {
            length: 0,
            bytes: [0; 47],
        };
        let name = identity.name.get().map_or("", |name| name);
        let length = name.floor_char_boundary(copy.bytes.len());
        copy.bytes[..length].copy_from_slice(&name.as_bytes()[..length]);
        copy.length = length as u8; // at most 47
        copy
    }

    fn get(&self) -> Option<&str> {
        let bytes = &self.bytes[..usize::from(self.length)];
        let name = core::str::from_utf8(bytes).ok();
        name.filter(|name| !name.is_empty())
    }
}

impl fmt::Debug for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.get().fmt(f)
    }
}

luna_platform::local! {
    static LAST: Cell<Option<FailedAt>> = const { Cell::new(None) };
}

/// Notes that an operation of the calling process has failed at `wait_point`. Outside of a process
/// nobody asks for it. O(1), without allocation.
#[cold]
pub(crate) fn note(wait_point: &WaitPoint, sends: bool, poisoned: bool) {
    let user = current::user();
    if user == User::Outside {
        return;
    }
    // In a failed branch it is no matter of the channel, the lock of which may be another
    // executor's.
    let partner = if poisoned && current::branch_failed() {
        None
    } else {
        let lists = wait_point.lock_briefly();
        let partner = if sends {
            &lists.receiver
        } else {
            &lists.sender
        };
        partner.get()
    };
    LAST.set(Some(FailedAt {
        user,
        sends,
        poisoned,
        made_at: wait_point.identity.made_at,
        nth: wait_point.identity.nth,
        partner,
        name: Name::of(&wait_point.identity),
    }));
}

/// The channel at which an operation of the calling process failed last, if no other process of
/// its thread has failed at one since.
///
/// ```
/// use luna_channels::inspect;
///
/// assert_eq!(inspect::failed_at(), None); // on no process
/// ```
pub fn failed_at() -> Option<FailedAt> {
    LAST.get().filter(|last| last.user == current::user())
}
