//! What there is between the programs of this computer, seen from outside.
//!
//! A look opens the files of a channel to read them, maps its words without the right to write, and
//! takes no lock: so it disturbs nobody, whatever priority it has, and wherever it is stopped. It
//! shows the words one after the other: what changes meanwhile may show in one and not in another.
//!
//! Not for the real-time path: it makes system calls and allocates.
//!
//! ```
//! use luna_ipc::look;
//!
//! let name = format!("doc/{}/look", std::process::id());
//! let (sender, link) = luna_ipc::sender::<f64>(&name)?;
//! let found = look::at(&name)?.unwrap();
//! assert_eq!((found.kind, &*found.value.name), (look::Kind::Channel, "f64"));
//! assert_eq!(found.sender.unwrap().pid, std::process::id());
//! assert!(found.receiver.is_none() && !found.is_joined);
//! assert!(look::all()?.found.iter().any(|found| found.name == name));
//! # drop((sender, link));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod readers;

pub use readers::readers;

use crate::blackboard;
use crate::error::TypeInfo;
use crate::files::LockFile;
use crate::memory::{Memory, Side};
use crate::name::{FOLDER, Name};
use crate::session::{OPEN, namespace};
use crate::{IpcError, Role};
use luna::Instant;
use std::fs;
use std::io;
use std::sync::atomic::Ordering::{Relaxed, SeqCst};

/// What a name stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Kind {
    /// A channel of plain data.
    Channel,
    /// A channel of a type of serde.
    Serde,
    /// A channel of values that are lent.
    Loan,
    /// A call channel.
    Call,
    /// A blackboard.
    Blackboard,
}

impl Kind {
    /// By what is stated as the type.
    pub(crate) fn of(info: &TypeInfo) -> Self {
        let name = &*info.name;
        match name {
            blackboard::TYPE => Kind::Blackboard,
            _ if name.contains(" -> ") && name.ends_with(" bytes)") => Kind::Call,
            _ if name.contains(", lent in ") && name.ends_with(" slots") => Kind::Loan,
            _ if name.ends_with(" by postcard") => Kind::Serde,
            _ => Kind::Channel,
        }
    }

    /// In a word.
    pub fn word(self) -> &'static str {
        match self {
            Kind::Channel => "channel",
            Kind::Serde => "serde",
            Kind::Loan => "loan",
            Kind::Call => "call",
            Kind::Blackboard => "blackboard",
        }
    }
}

/// A program that has a side of a channel.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Program {
    /// Its process. 0 if it has not said so yet, if it belongs to another PID namespace, and for
    /// the readers of a blackboard, which say nothing: see [`readers`].
    pub pid: u32,
    /// Whether its link sleeps until the other program rings, or until a process of its own
    /// program sends or receives.
    pub sleeps: bool,
    /// Whether it has closed or poisoned its side of the session.
    pub has_ended: bool,
}

/// A key of a blackboard.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Key {
    /// Its name.
    pub key: String,
    /// The type of its value.
    pub value: TypeInfo,
    /// The number of the newest value: 1 for the first, and one more for each that was set since.
    pub number: u64,
    /// When it was set, on the monotonic clock.
    pub set: Instant,
    /// The newest value, as it lies in memory. Empty if its writer has set it anew during each of
    /// eight copies.
    pub bytes: Vec<u8>,
}

/// A channel, call channel or blackboard.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Found {
    /// Its name.
    pub name: String,
    /// What it is.
    pub kind: Kind,
    /// The type of its values, as all programs state it that have it open.
    pub value: TypeInfo,
    /// The program that sends, calls or writes.
    pub sender: Option<Program>,
    /// The program that receives or serves; of a blackboard, one of its readers.
    pub receiver: Option<Program>,
    /// Whether the two programs have a session with each other. Never of a blackboard.
    pub is_joined: bool,
    /// Openings of the sender's side and of the receiver's until now. Two of them name a session.
    pub openings: [u64; 2],
    /// The number of the newest value; of a blackboard, the sum over its keys.
    pub sent: u64,
    /// The number of the last value that a process of the receiving program has taken.
    pub taken: u64,
    /// The keys of a blackboard, in the writer's order.
    pub keys: Vec<Key>,
}

impl Found {
    /// Whether a program has it open. If none has, its files were left by programs that were
    /// killed: the next opening removes them, or [`clean_up`](crate::clean_up).
    pub fn is_alive(&self) -> bool {
        self.sender.is_some() || self.receiver.is_some()
    }

    /// Whether a value was sent and is not taken yet: its sender waits for the receiver.
    pub fn is_under_way(&self) -> bool {
        self.is_joined && self.sent > self.taken
    }
}

/// What was found.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct All {
    /// In the order of their names.
    pub found: Vec<Found>,
    /// Names that cannot be looked at: of other users, or of another version of this crate.
    pub hidden: usize,
}

/// All channels, call channels and blackboards of this computer that this user may look at.
///
/// # Errors
///
/// The folder of shared memory cannot be read.
pub fn all() -> io::Result<All> {
    let mut all = All {
        found: Vec::new(),
        hidden: 0,
    };
    for entry in fs::read_dir(FOLDER)? {
        let Ok(entry) = entry else { continue };
        let file = entry.file_name();
        let Some(name) = file.to_str().and_then(Name::of_lock) else {
            continue;
        };
        match look(&name) {
            Ok(found) => all.found.extend(found),
            Err(_) => all.hidden = all.hidden.saturating_add(1),
        }
    }
    all.found.sort_by(|one, other| one.name.cmp(&other.name));
    Ok(all)
}

/// What is there under this name; `None`: nothing, or it is being opened or removed at this moment.
///
/// # Errors
///
/// [`IpcError`]: the name cannot be one, the files are those of another user, or of another version
/// of this crate.
pub fn at(name: &str) -> Result<Option<Found>, IpcError> {
    look(&Name::new(name)?)
}

fn look(name: &Name) -> Result<Option<Found>, IpcError> {
    let Some(lock) = LockFile::look(name)? else {
        return Ok(None);
    };
    let Some(memory) = Memory::look(name)? else {
        return Ok(None);
    };
    let words = memory.words();
    let value = words.stated();
    let kind = Kind::of(&value);
    let own_namespace = namespace(name)?;
    let [sender, receiver] = [Role::Sender, Role::Receiver].map(|role| words.side(role));
    let program = |role: Role, side: &Side| -> Result<Option<Program>, IpcError> {
        if !lock.is_held(role)? {
            return Ok(None);
        }
        let is_here = side.namespace.load(Relaxed) == own_namespace;
        let ends = kind != Kind::Blackboard && side.end.load(SeqCst) != OPEN;
        Ok(Some(Program {
            pid: if is_here { side.pid.load(Relaxed) } else { 0 },
            sleeps: side.asleep.load(SeqCst) != 0,
            has_ended: ends,
        }))
    };
    // What the sender has done is read last, so that nothing is taken that was not sent.
    let (sends, receives) = (
        program(Role::Sender, sender)?,
        program(Role::Receiver, receiver)?,
    );
    let openings = [sender, receiver].map(|side| side.epoch.load(SeqCst));
    let bound = [sender, receiver].map(|side| side.bound.load(SeqCst));
    let taken = words.taken();
    let keys = match kind {
        // Its directory is whole before the first opening is counted.
        Kind::Blackboard if openings[0] > 0 => blackboard::keys(&memory),
        _ => Vec::new(),
    };
    let sent = match kind {
        Kind::Blackboard => keys
            .iter()
            .fold(0, |sum: u64, key| sum.saturating_add(key.number)),
        _ => words.published(),
    };
    Ok(Some(Found {
        name: name.text().to_owned(),
        kind,
        value,
        is_joined: sends.is_some()
            && receives.is_some()
            && openings[0] > 0
            && bound == [openings[1], openings[0]],
        sender: sends,
        receiver: receives,
        openings,
        sent,
        taken,
        keys,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_known_by_what_is_stated() {
        let plain = TypeInfo::of::<[f32; 4]>(0);
        for (info, kind) in [
            (plain.clone(), Kind::Channel),
            (plain.lent(3), Kind::Loan),
            (plain.call(&TypeInfo::of::<u64>(0)), Kind::Call),
            (
                TypeInfo::new(blackboard::TYPE, 4096, 1, 0),
                Kind::Blackboard,
            ),
            (
                TypeInfo::new("alloc::string::String by postcard", 80, 1, 0),
                Kind::Serde,
            ),
        ] {
            assert_eq!(Kind::of(&info), kind, "{info}");
        }
    }
}
