//! What a system is made of: the tree of its threads, processes and sub-processes, and the channels
//! between them, as data.

pub use luna_channels::inspect::WaitPointKind as ChannelKind;
use luna_core::ProcessState;
use luna_core::current::ProcessId;
use luna_platform::thread::{Attributes, Obtained, Policy};
use std::fmt;

/// What a system was made of when it was looked at: see
/// [`System::composition`](crate::System::composition).
///
/// Its `Display` is the tree, indented, then the channels. While the system runs each part of it
/// was so at some moment of the look, not all at the same.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Composition {
    /// The system's name.
    pub system: String,
    /// The executors, then the OS threads, in the order of their making.
    pub threads: Vec<ThreadPart>,
    /// The channels and barriers that its processes have used or wait at, in the order of their
    /// making.
    pub channels: Vec<ChannelPart>,
}

/// What runs on a thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ThreadKind {
    /// Many processes, by priority.
    Executor,
    /// One process alone.
    OsThread,
}

/// An executor or OS thread.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct ThreadPart {
    /// Its name.
    pub name: String,
    /// What it is.
    pub kind: ThreadKind,
    /// The policy that it has; before the start, the requested one.
    pub policy: Policy,
    /// The core that it is pinned to; before the start, the requested one.
    pub core: Option<usize>,
    /// Its processes, in the order of their spawning, also those that have ended.
    pub processes: Vec<ProcessPart>,
}

/// What a process is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ProcessKind {
    /// A process of an executor.
    UserThread,
    /// A process with an OS thread of its own.
    OsThread,
    /// A named part of a process: see [`named`](crate::named()).
    SubProcess,
}

/// A process or a named sub-process.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct ProcessPart {
    /// Its name; of a sub-process the first 63 bytes.
    pub name: String,
    /// Its number; of a sub-process, that of its process.
    pub id: ProcessId,
    /// What it is.
    pub kind: ProcessKind,
    /// What it was doing. A sub-process that does not run counts as waiting, also when its process
    /// is ready.
    pub state: ProcessState,
    /// Its level on its executor, 0 (lowest) to 31; of a sub-process, when it ran last.
    pub priority: u8,
    /// The named sub-processes that live in it, in the order in which they began.
    pub children: Vec<ProcessPart>,
}

/// A user of an end of a channel.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum EndUser {
    /// The process of this name.
    Process(String),
    /// Outside of the system: a plain thread, or a process of another system.
    Outside,
}

/// A channel, barrier or lock.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct ChannelPart {
    /// The name that it was given.
    pub name: Option<String>,
    /// Where in the program it was made: file, line and column; of several that were made there,
    /// which one: "src/main.rs:12:5 (2)".
    pub made_at: String,
    /// What it is, and how many values it can hold.
    pub kind: ChannelKind,
    /// How many values it holds.
    pub buffered: usize,
    /// Whether a send into a full buffer drops a value.
    pub overwrites: bool,
    /// Whether it is marked as used from outside of the system.
    pub external: bool,
    /// Whether it was poisoned, or all its senders or receivers are gone.
    pub ended: bool,
    /// The last user that sent, or offered to; `None` if there is none.
    pub sender: Option<EndUser>,
    /// The last user that received, or offered to; `None` if there is none.
    pub receiver: Option<EndUser>,
    /// The waiting parts.
    pub waiting: Vec<WaitingPart>,
}

/// A user that waits at a channel, barrier or lock.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct WaitingPart {
    /// The waiting user.
    pub user: EndUser,
    /// Whether it waits to send; at a channel, it else waits to receive.
    pub sends: bool,
}

impl ThreadPart {
    /// An executor to be.
    pub(crate) fn executor(attributes: &Attributes) -> Self {
        Self::asked(ThreadKind::Executor, attributes)
    }

    /// A thread to be.
    pub(crate) fn asked(kind: ThreadKind, attributes: &Attributes) -> Self {
        Self {
            name: attributes.name().to_owned(),
            kind,
            policy: attributes.asked_policy(),
            core: attributes.asked_core(),
            processes: Vec::new(),
        }
    }

    /// A thread with what it obtained.
    pub(crate) fn obtained(name: &str, kind: ThreadKind, obtained: Option<&Obtained>) -> Self {
        Self {
            name: name.to_owned(),
            kind,
            policy: obtained.map_or(Policy::Other, |got| got.policy),
            core: obtained.and_then(|got| got.core),
            processes: Vec::new(),
        }
    }
}

impl Composition {
    /// The first process or sub-process of this name, from the root down, parents before their
    /// children. O(processes).
    pub fn find(&self, name: &str) -> Option<&ProcessPart> {
        let roots = self.threads.iter().flat_map(|thread| &thread.processes);
        roots.into_iter().find_map(|process| process.find(name))
    }
}

impl ProcessPart {
    fn find(&self, name: &str) -> Option<&ProcessPart> {
        if self.name == name {
            return Some(self);
        }
        self.children.iter().find_map(|child| child.find(name))
    }

    fn print(&self, f: &mut fmt::Formatter<'_>, depth: usize) -> fmt::Result {
        let kind = match self.kind {
            ProcessKind::UserThread => "process",
            ProcessKind::OsThread => "OS-thread process",
            ProcessKind::SubProcess => "sub-process",
        };
        let state = match self.state {
            ProcessState::Created => "not started",
            ProcessState::Ready => "ready",
            ProcessState::Running => "running",
            ProcessState::Ended => "ended",
            _ => "waiting",
        };
        writeln!(
            f,
            "{:indent$}{kind} `{}`: priority {}, {state}",
            "",
            self.name,
            self.priority,
            indent = 2 * depth
        )?;
        let mut children = self.children.iter();
        children.try_for_each(|child| child.print(f, depth + 1))
    }
}

impl fmt::Display for Composition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "system `{}`", self.system)?;
        for thread in &self.threads {
            let kind = match thread.kind {
                ThreadKind::Executor => "executor",
                ThreadKind::OsThread => "OS thread",
            };
            let core = thread
                .core
                .map_or("any core".to_owned(), |core| format!("core {core}"));
            writeln!(f, "  {kind} `{}`: {}, {core}", thread.name, thread.policy)?;
            let mut processes = thread.processes.iter();
            processes.try_for_each(|process| process.print(f, 2))?;
        }
        let mut channels = self.channels.iter();
        channels.try_for_each(|channel| writeln!(f, "  {channel}"))
    }
}

impl fmt::Display for EndUser {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            EndUser::Process(name) => write!(f, "`{name}`"),
            EndUser::Outside => f.write_str("outside"),
        }
    }
}

/// What a wait point is called in texts.
pub(crate) fn kind_name(kind: ChannelKind) -> &'static str {
    match kind {
        ChannelKind::Barrier => "barrier",
        ChannelKind::Mutex => "mutex",
        ChannelKind::Condition => "condition",
        ChannelKind::Semaphore => "semaphore",
        _ => "channel",
    }
}

impl fmt::Display for ChannelPart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = kind_name(self.kind);
        let is_channel = kind == "channel";
        f.write_str(kind)?;
        match &self.name {
            Some(name) => write!(f, " `{name}`")?,
            None => write!(f, " made at {}", self.made_at)?,
        }
        if let (ChannelKind::Mutex, Some(holder)) = (self.kind, &self.receiver) {
            write!(f, ": held by {holder}")?;
        }
        if is_channel {
            let user = |user: &Option<EndUser>| match user {
                Some(user) => user.to_string(),
                None => "nobody yet".to_owned(),
            };
            let (sender, receiver) = (user(&self.sender), user(&self.receiver));
            write!(f, ": {sender} -> {receiver}, ")?;
            match self.kind {
                ChannelKind::Buffered(usize::MAX) => write!(f, "{} buffered", self.buffered)?,
                ChannelKind::Buffered(most) => write!(f, "{} of {most} buffered", self.buffered)?,
                _ => f.write_str("rendezvous")?,
            }
        }
        if self.external {
            f.write_str(", external")?;
        }
        if self.ended {
            f.write_str(", ended")?;
        }
        for (place, waiting) in self.waiting.iter().enumerate() {
            f.write_str(if place == 0 { "; " } else { ", " })?;
            let what = match (is_channel, waiting.sends) {
                (false, _) => "waits",
                (true, true) => "waits to send",
                (true, false) => "waits to receive",
            };
            write!(f, "{} {what}", waiting.user)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn process(name: &str, kind: ProcessKind, children: Vec<ProcessPart>) -> ProcessPart {
        ProcessPart {
            name: name.to_owned(),
            id: ProcessId::new(),
            kind,
            state: ProcessState::Waiting,
            priority: 16,
            children,
        }
    }

    fn example() -> Composition {
        let axis = process(
            "axis",
            ProcessKind::SubProcess,
            vec![process("pid", ProcessKind::SubProcess, Vec::new())],
        );
        Composition {
            system: "plant".to_owned(),
            threads: vec![ThreadPart {
                name: "control".to_owned(),
                kind: ThreadKind::Executor,
                policy: Policy::fifo(80),
                core: Some(1),
                processes: vec![process("loop", ProcessKind::UserThread, vec![axis])],
            }],
            channels: vec![ChannelPart {
                name: Some("setpoint".to_owned()),
                made_at: "src/main.rs:1:1".to_owned(),
                kind: ChannelKind::Buffered(4),
                buffered: 1,
                overwrites: false,
                external: false,
                ended: true,
                sender: Some(EndUser::Outside),
                receiver: None,
                waiting: vec![WaitingPart {
                    user: EndUser::Process("loop".to_owned()),
                    sends: false,
                }],
            }],
        }
    }

    #[test]
    fn the_tree_is_indented_by_what_is_in_what() {
        assert_eq!(
            example().to_string(),
            "system `plant`\n  executor `control`: fifo:80, core 1\n    process `loop`: priority 16, waiting\n      \
             sub-process `axis`: priority 16, waiting\n        sub-process `pid`: priority 16, waiting\n  \
             channel `setpoint`: outside -> nobody yet, 1 of 4 buffered, ended; `loop` waits to receive\n"
        );
    }

    #[test]
    fn a_part_is_found_at_any_depth() {
        assert_eq!(example().find("pid").unwrap().name, "pid");
        assert_eq!(example().find("loop").unwrap().children.len(), 1);
        assert!(example().find("nobody").is_none());
    }
}
