//! What can go wrong.

use std::fmt;
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

/// A program that has a side of a channel.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct Peer {
    /// Its process, by its own computer's numbers.
    pub pid: u32,
    /// Its computer's name.
    pub host: String,
}

impl fmt::Display for Peer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "process {} on `{}`", self.pid, self.host)
    }
}

/// A value's type, as a program states it.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct TypeInfo {
    /// Its name, by [`std::any::type_name`].
    pub name: String,
    /// The [layout version](crate::Endpoint::layout_version).
    pub version: u32,
}

impl fmt::Display for TypeInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}` (layout version {})", self.name, self.version)
    }
}

/// How it was noticed that a partner is lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Sign {
    /// zenoh has no connection to it any more: its program has ended, or the connection broke.
    Disconnected,
    /// Nothing was heard of it for this time, which is [`lost_after`](crate::Config::lost_after).
    Silent(Duration),
}

impl fmt::Display for Sign {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Sign::Disconnected => f.write_str("its connection has ended"),
            Sign::Silent(time) => write!(f, "nothing was heard of it for {time:?}"),
        }
    }
}

/// Why a network or a channel cannot be opened, or has failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NetError {
    /// The configuration's file cannot be read.
    #[error("cannot read the configuration `{}`: {source}: check the path and its access rights", file.display())]
    Unreadable {
        /// The file.
        file: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The configuration is wrong.
    #[error("configuration {place}: key `{key}`: {why}")]
    Config {
        /// The file, or that it was made by the program.
        place: String,
        /// The key, with `/` between its parts; empty if the whole is no JSON5.
        key: String,
        /// What is wrong, and what to do.
        why: String,
    },
    /// An address beyond this computer in a configuration that is for this computer alone.
    #[error(
        "`{address}` is beyond loopback: begin with `Config::network()` or a file to let other computers in, or use 127.0.0.1"
    )]
    BeyondLoopback {
        /// The address.
        address: String,
    },
    /// zenoh cannot open the network.
    #[error(
        "cannot open the network (listens on {listens:?}, connects to {connects:?}): {why}: check that the addresses are free and reachable, and the certificates"
    )]
    Open {
        /// Where it was to listen.
        listens: Vec<String>,
        /// What it was to connect to.
        connects: Vec<String>,
        /// zenoh's error.
        why: String,
    },
    /// The name cannot be that of a channel.
    #[error(
        "`{name}` cannot be the name of a channel: use 1 to 180 letters, digits, `_`, `-`, `.`, and `/` between two of those"
    )]
    Name {
        /// The name.
        name: String,
    },
    /// This program, or another one that lives, has this side of the channel.
    #[error(
        "channel `{name}` has a {role} already, {holder}: end that program, or use another name"
    )]
    Busy {
        /// The channel.
        name: String,
        /// The side.
        role: Role,
        /// Who has it.
        holder: Peer,
    },
    /// The other program states another type.
    #[error(
        "channel `{name}`: this program's {role} carries {here}, {peer} carries {there}: build both from one definition"
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
        /// The other program.
        peer: Peer,
    },
    /// The other program has ended without closing the channel, or cannot be reached any more.
    #[error(
        "channel `{name}`: the {role}, {peer}, is lost: {sign}; {acknowledged} values were acknowledged, and of {in_doubt} it is unknown whether they were taken: open the channel again for the next session"
    )]
    PartnerLost {
        /// The channel.
        name: String,
        /// The side of the program that is lost.
        role: Role,
        /// The program.
        peer: Peer,
        /// How it was noticed.
        sign: Sign,
        /// Values of this session that were acknowledged.
        acknowledged: u64,
        /// Values that were sent and not acknowledged: each was taken once or not at all, and only
        /// the other program could say. None of them comes any more. 0 on the receiving side.
        in_doubt: u64,
    },
    /// A value cannot be encoded: it is larger than its buffer, or its type refuses.
    #[error(
        "channel `{name}`: a value cannot be encoded in {capacity} bytes: {why}: state a larger capacity"
    )]
    Encode {
        /// The channel.
        name: String,
        /// The bytes that a value may have.
        capacity: usize,
        /// The error of postcard.
        why: String,
    },
    /// A value cannot be decoded: the programs define its type differently.
    #[error(
        "channel `{name}`: value {number} of {peer} cannot be decoded: {why}: build both programs from one definition of its type"
    )]
    Decode {
        /// The channel.
        name: String,
        /// The value's number.
        number: u64,
        /// The other program.
        peer: Peer,
        /// The error of postcard.
        why: String,
    },
    /// zenoh or the system refuses something.
    #[error("channel `{name}`: cannot {what}: {why}")]
    System {
        /// The channel.
        name: String,
        /// What was to be done.
        what: &'static str,
        /// The error.
        why: String,
    },
    /// The link's thread has ended by a panic.
    #[error("channel `{name}`: the link's thread has ended: see its panic on standard error")]
    ThreadEnded {
        /// The channel.
        name: String,
    },
    /// The link runs on a virtual clock, which does not wait for other computers.
    #[error(
        "channel `{name}`: another computer does not follow a virtual clock: connect the processes by an ordinary channel in a simulation"
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

impl From<NetError> for luna::Error {
    fn from(error: NetError) -> Self {
        luna::Error::other(error)
    }
}
