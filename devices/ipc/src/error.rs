//! What can go wrong.

use crate::ZeroCopySend;
use std::fmt;
use std::io;
use std::path::PathBuf;
use std::time::Duration;

/// The side of a channel that a program has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Role {
    /// It sends.
    Sender,
    /// It receives.
    Receiver,
}

impl Role {
    pub(crate) fn other(self) -> Role {
        match self {
            Role::Sender => Role::Receiver,
            Role::Receiver => Role::Sender,
        }
    }

    pub(crate) fn word(self) -> &'static str {
        match self {
            Role::Sender => "sender",
            Role::Receiver => "receiver",
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// A value's type, as a program states it.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct TypeInfo {
    /// Its name, cut to 240 bytes.
    pub name: String,
    /// Its size in bytes.
    pub size: u64,
    /// Its alignment in bytes.
    pub align: u64,
    /// The [layout version](crate::Endpoint::layout_version).
    pub version: u32,
}

/// The longest name of a type that is compared.
pub(crate) const TYPE_NAME: usize = 240;

impl TypeInfo {
    pub(crate) fn of<T: ZeroCopySend>(version: u32) -> Self {
        // SAFETY: the implementation of `ZeroCopySend` promises that types of this name have one
        // layout. Size, alignment and version are compared beside it.
        let name = unsafe { <T as ZeroCopySend>::type_name() };
        Self::new(name, size_of::<T>(), align_of::<T>(), version)
    }

    /// Of values that are lent, in so many slots.
    pub(crate) fn lent(&self, slots: usize) -> Self {
        let name = &self.name[..self.name.floor_char_boundary(TYPE_NAME - 40)];
        Self {
            name: format!("{name}, lent in {slots} slots"),
            ..self.clone()
        }
    }

    /// Of calls with this request and that answer.
    pub(crate) fn call(&self, answer: &TypeInfo) -> Self {
        let part = |info: &TypeInfo| {
            let name = &info.name[..info.name.floor_char_boundary(TYPE_NAME / 2 - 24)];
            format!("{name} ({} bytes)", info.size)
        };
        Self {
            name: format!("{} -> {}", part(self), part(answer)),
            size: self.size.saturating_add(answer.size),
            align: self.align.max(answer.align),
            version: self.version,
        }
    }

    pub(crate) fn new(name: &str, size: usize, align: usize, version: u32) -> Self {
        Self {
            name: name[..name.floor_char_boundary(TYPE_NAME)].to_owned(),
            size: size as u64,
            align: align as u64,
            version,
        }
    }
}

impl fmt::Display for TypeInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            name,
            size,
            align,
            version,
        } = self;
        write!(
            f,
            "`{name}` ({size} bytes, alignment {align}, layout version {version})"
        )
    }
}

/// Why a channel cannot be opened, or has failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IpcError {
    /// The name cannot be that of a channel.
    #[error(
        "`{name}` cannot be the name of a channel: use 1 to 180 letters, digits, `_`, `-`, `.` and `/`"
    )]
    Name {
        /// The name.
        name: String,
    },
    /// Another program, or another part of this one, has this side of the channel.
    #[error(
        "channel `{name}` has a {role} already, process {pid}: end that process, or use another name"
    )]
    Busy {
        /// The channel.
        name: String,
        /// The side.
        role: Role,
        /// The process that has it; 0 if it has not said so yet.
        pid: u32,
    },
    /// The other program states another type.
    #[error(
        "channel `{name}`: this program's {role} carries {here}, process {pid} carries {there}: build both from one definition, or name the type by #[type_name(..)]"
    )]
    Type {
        /// The channel.
        name: String,
        /// The side of this program.
        role: Role,
        /// What this program states.
        here: Box<TypeInfo>,
        /// What the other program states.
        there: Box<TypeInfo>,
        /// The other process.
        pid: u32,
    },
    /// The other program speaks another version of the protocol, or the memory is no channel's.
    #[error(
        "channel `{name}`: its shared memory is not of this version of luna-ipc: build both programs with the same one"
    )]
    Protocol {
        /// The channel.
        name: String,
    },
    /// The other program is in another namespace for process numbers, so its death could not be
    /// noticed.
    #[error(
        "channel `{name}`: process {pid} of the other program belongs to another PID namespace, so its end cannot be noticed: run both in one (docker: --pid)"
    )]
    Namespace {
        /// The channel.
        name: String,
        /// The other process, by its own namespace.
        pid: u32,
    },
    /// The system refuses something.
    #[error("channel `{name}`: cannot {what}: {source}{}", remedy(source))]
    System {
        /// The channel.
        name: String,
        /// What was to be done.
        what: &'static str,
        /// The system's error.
        source: io::Error,
    },
    /// There is no room for the channel's shared memory: it is taken when a channel is opened, so
    /// that no operation on it can want for memory.
    #[error(
        "channel `{name}`: it needs {size} bytes of shared memory, and {free} are free in {}: {}",
        place(*in_folder),
        enlarge(*in_folder)
    )]
    Room {
        /// The channel.
        name: String,
        /// The bytes that it needs.
        size: u64,
        /// The bytes that are free.
        free: u64,
        /// Whether `/dev/shm` is too small; else it is the memory of the computer, or of the
        /// control group.
        in_folder: bool,
    },
    /// The system refuses the shared memory.
    #[error(
        "channel `{name}`: cannot {what} its shared memory: {why}: check the limits of addresses (`ulimit -v`) and of locked memory (`ulimit -l`)"
    )]
    Memory {
        /// The channel.
        name: String,
        /// What was to be done.
        what: &'static str,
        /// The system's error.
        why: String,
    },
    /// What the programs state takes more memory than addresses reach.
    #[error(
        "channel `{name}`: {value} takes more memory than there are addresses: state a smaller capacity, or fewer values"
    )]
    Size {
        /// The channel.
        name: String,
        /// What is stated.
        value: Box<TypeInfo>,
    },
    /// A file of the channel is not this user's alone: another user may have made it, or may
    /// change it.
    #[error(
        "channel `{name}`: {} is not used, since {why}: remove it as its owner or as root, or use another name",
        path.display()
    )]
    Foreign {
        /// The channel.
        name: String,
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// Another program has held the set-up lock for longer than an opening or closing takes: it was
    /// stopped, or takes the lock for something else.
    #[error(
        "channel `{name}`: another program has held its lock for {} s: see which one by `fuser {}`, and continue or end it",
        waited.as_secs(),
        path.display()
    )]
    Held {
        /// The channel.
        name: String,
        /// The lock file.
        path: PathBuf,
        /// How long this program has waited.
        waited: Duration,
    },
    /// The other program has ended without closing the channel: it was killed, or has crashed.
    #[error(
        "channel `{name}`: the {role}, process {pid}, has ended without closing it; {acknowledged} values were acknowledged: open the channel again for the next session"
    )]
    PartnerDied {
        /// The channel.
        name: String,
        /// The side of the program that has ended.
        role: Role,
        /// The process that has ended.
        pid: u32,
        /// Values of this session that were acknowledged.
        acknowledged: u64,
    },
    /// The other program has written what the protocol does not allow.
    #[error(
        "channel `{name}`: process {pid} has written number {number} after {expected}: it is not a luna-ipc of this version, or its memory was overwritten"
    )]
    Broken {
        /// The channel.
        name: String,
        /// The other process.
        pid: u32,
        /// What it has written.
        number: u64,
        /// The number before.
        expected: u64,
    },
    /// A value cannot be encoded: it is larger than its place, or its type refuses.
    #[error(
        "channel `{name}`: a value cannot be encoded in {capacity} bytes: {why}: open both sides with a larger capacity"
    )]
    Encode {
        /// The channel.
        name: String,
        /// The bytes that a value may have, and its length.
        capacity: usize,
        /// The error of postcard.
        why: String,
    },
    /// A value cannot be decoded: the programs define its type differently.
    #[error(
        "channel `{name}`: a value of process {pid} cannot be decoded: {why}: build both programs from one definition of its type"
    )]
    Decode {
        /// The channel.
        name: String,
        /// The other process.
        pid: u32,
        /// The error of postcard.
        why: String,
    },
    /// No program has written the blackboard yet, or all that had it open have gone.
    #[error("blackboard `{name}`: no program has it open: open it when its writer runs")]
    NoBoard {
        /// The blackboard.
        name: String,
    },
    /// A blackboard has no such key, has it twice, or its entry was taken already.
    #[error("blackboard `{name}`: key `{key}` {why}")]
    Key {
        /// The blackboard.
        name: String,
        /// The key.
        key: String,
        /// What is wrong with it.
        why: &'static str,
    },
    /// The link runs on a virtual clock, which does not wait for other programs.
    #[error(
        "channel `{name}`: another program does not follow a virtual clock: connect the processes by an ordinary channel in a simulation"
    )]
    VirtualClock {
        /// The channel.
        name: String,
    },
    /// The link was run twice.
    #[error("channel `{name}`: a link runs once: open the channel again")]
    RunTwice {
        /// The channel.
        name: String,
    },
}

fn remedy(error: &io::Error) -> &'static str {
    match error.raw_os_error() {
        Some(libc::ENOSPC) => {
            ": /dev/shm has room for no more files: remove what fills it (`df -i /dev/shm`)"
        }
        Some(libc::EMFILE) => ": raise this program's limit of open files (`ulimit -n`)",
        _ => "",
    }
}

fn place(in_folder: bool) -> &'static str {
    match in_folder {
        true => "/dev/shm",
        false => "the memory of the computer or its control group",
    }
}

fn enlarge(in_folder: bool) -> &'static str {
    match in_folder {
        true => {
            "remove what fills it, state smaller values, or enlarge it (`mount -o remount,size=256m /dev/shm` as root; docker: --shm-size=256m)"
        }
        false => {
            "end other programs, state smaller values, or raise the limit of memory (docker: --memory)"
        }
    }
}

impl IpcError {
    pub(crate) fn system(name: &str, what: &'static str, source: impl Into<io::Error>) -> Self {
        Self::System {
            name: name.to_owned(),
            what,
            source: source.into(),
        }
    }
}

impl From<IpcError> for luna::Error {
    fn from(error: IpcError) -> Self {
        luna::Error::other(error)
    }
}
