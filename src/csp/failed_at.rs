//! The channels at which processes have ended: noted as they end, named in the report.

use luna_channels::inspect::FailedAt;
use luna_core::current::{ProcessId, User};
use luna_platform::lock::PiLock;
use std::fmt;

/// How many a system names. They are noted by processes that end, so without allocation.
const KEPT: usize = 64;

/// A channel at which a process has ended, since an operation found it closed or poisoned: part of
/// a [`Report`](crate::Report).
///
/// Its `Display` has all of it: "process `pump` ended: the receivers of channel `level`, made at
/// src/main.rs:12, are gone; the last one was process `display`".
///
/// ```
/// use luna::prelude::*;
///
/// let (level, levels) = luna::channel();
/// let level = level.named("level");
/// let mut system = System::new("tank");
/// let main = system.executor("main").build()?;
/// main.process("display").spawn(async move {
///     levels.recv().await?;
///     Ok(()) // one was enough
/// })?;
/// main.process("pump").spawn(async move {
///     loop {
///         level.send(7).await?; // ends the process, in order, when nothing receives any more
///     }
/// })?;
/// let report = system.run()?;
/// let end = &report.ended_at[0];
/// assert_eq!((end.process.as_str(), end.channel.as_deref()), ("pump", Some("level")));
/// assert_eq!(end.partner.as_deref(), Some("display"));
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct EndedAt {
    /// The process that ended.
    pub process: String,
    /// The channel's name, if it was given one.
    pub channel: Option<String>,
    /// Where in the program it was made: file and line; of several that were made there, which one.
    pub made_at: String,
    /// Whether the process was sending; else it was receiving.
    pub sends: bool,
    /// Whether the channel was poisoned, or a sibling in a parallel construct has failed; else the
    /// other ends are gone, which is an end in order.
    pub poisoned: bool,
    /// The process that used the other ends last, if one did.
    pub partner: Option<String>,
}

impl EndedAt {
    fn of(at: &FailedAt, name: &dyn Fn(ProcessId) -> Option<String>) -> Option<Self> {
        let of_user = |user| match user {
            User::Process(process) => name(process),
            User::Outside => None,
        };
        Some(Self {
            process: of_user(at.user)?,
            channel: at.name().map(str::to_owned),
            made_at: at.place(),
            sends: at.sends,
            poisoned: at.poisoned,
            partner: at.partner.and_then(of_user),
        })
    }
}

impl fmt::Display for EndedAt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let others = if self.sends { "receivers" } else { "senders" };
        write!(f, "process `{}` ended: ", self.process)?;
        if !self.poisoned {
            write!(f, "the {others} of ")?;
        }
        match &self.channel {
            Some(name) => write!(f, "channel `{name}`, made at {},", self.made_at)?,
            None => write!(f, "the channel made at {}", self.made_at)?,
        }
        f.write_str(match self.poisoned {
            true => " is poisoned, or a sibling in a parallel construct has failed",
            false => " are gone",
        })?;
        match &self.partner {
            Some(partner) => write!(f, "; the last of its {others} was process `{partner}`"),
            None => Ok(()),
        }
    }
}

/// Those of a system, in the order of the ends.
pub(crate) struct EndedAtChannels(PiLock<Vec<FailedAt>>);

impl EndedAtChannels {
    pub(crate) fn new() -> Self {
        Self(PiLock::new(Vec::with_capacity(KEPT)))
    }

    /// Notes one; as many as are kept. O(1), without allocation.
    pub(crate) fn note(&self, at: FailedAt) {
        let mut noted = self.0.lock();
        if noted.len() < noted.capacity() {
            noted.push(at);
        }
    }

    pub(crate) fn named(&self, name: &dyn Fn(ProcessId) -> Option<String>) -> Vec<EndedAt> {
        let noted = std::mem::take(&mut *self.0.lock());
        let named = noted.iter().map(|at| EndedAt::of(at, name));
        named.flatten().collect()
    }
}
