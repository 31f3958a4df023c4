//! A deadlock, and its text.

use std::fmt;

/// A deadlock: every process of a system waits, and nothing known to the system can wake one of
/// them.
///
/// The system knows of deadlines, files, calls of `blocking`, of processes that
/// compute or block, and of channels that are marked `external` or were
/// last used at their other end by a thread outside of the system, before the start too. A process
/// that waits for anything else (another runtime's channel, say) may be woken by it, so no deadlock
/// is reported then.
///
/// Two things cannot be seen, and must be marked `external()`: an end (or a party of a barrier)
/// that a thread outside of the system holds and has not used yet; and a channel that a process
/// waits for together with something outside of LUNA, as in a race of both. A
/// barrier that a thread of its own (`luna::run`) has come to is
/// known to have such a party; one with parties in two systems must be marked.
///
/// The process that an end belongs to is known once it has used the end. For an unused end the
/// report names the processes that contain the channel's address in their bodies
/// ([`Partner::Holders`]): they appear to hold it. An end that lies in a `Vec` or a `Box` is not
/// found so.
///
/// Its `Display` is a line for each wait, and the circle.
///
/// ```
/// use luna::prelude::*;
/// use luna::Error;
///
/// let (a, from_a) = luna::channel::<u32>();
/// let (b, from_b) = luna::channel::<u32>();
/// let mut system = System::new("stuck");
/// system.strict();
/// let main = system.executor("main").build()?;
/// main.process("left").spawn(async move {
///     let n = from_b.recv().await?; // each waits for the other first
///     a.send(n).await?;
///     Ok(())
/// })?;
/// main.process("right").spawn(async move {
///     let n = from_a.recv().await?;
///     b.send(n).await?;
///     Ok(())
/// })?;
/// let Err(Error::Deadlock(deadlock)) = system.run() else { panic!("it ends") };
/// assert_eq!(deadlock.waits.len(), 2);
/// assert_eq!(deadlock.waits[0].process, "left");
/// println!("{deadlock}");
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Deadlock {
    /// The system's name.
    pub system: String,
    /// What the processes wait for: in the order of their spawning, and all that one waits for, if
    /// it is an alternative or a parallel construct, one after the other.
    pub waits: Vec<Wait>,
    /// Processes of which each waits for the next, and the last for the first. Empty where no such
    /// circle is known.
    pub cycle: Vec<String>,
}

/// One of the things that a process waits for.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Wait {
    /// The name of the process that waits.
    pub process: String,
    /// To do what.
    pub operation: Operation,
    /// Where: the name of the channel, barrier or lock, or where it was made; or the name of the
    /// process that is awaited at its end.
    pub at: String,
    /// The awaited partner, as far as it is known.
    pub partner: Partner,
}

/// What a process waits to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Operation {
    /// To send.
    Send,
    /// To receive.
    Receive,
    /// To meet others at a barrier.
    Sync,
    /// To lock a mutex.
    Lock,
    /// To be notified at a condition.
    Notified,
    /// To acquire permits of a semaphore.
    Acquire,
    /// Waits for the end of another process.
    Join,
    /// Nothing: it is in an alternative without an open guard, which is STOP.
    Stop,
}

/// The partner that a process waits for: the last user of the other end; the holder of the mutex;
/// the last process that notified at the condition, or took permits of the semaphore.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Partner {
    /// For the process of this name, which waits too.
    Process(String),
    /// For the process of this name, which has ended.
    Ended(String),
    /// The other end is unused so far, and it is not known which process holds it.
    Nobody,
    /// The other end is unused so far, but the processes of these names appear to hold it, or one
    /// of them: the channel's address lies in their bodies. They wait too.
    Holders(Vec<String>),
    /// All parties of the barrier that have not arrived.
    Others,
}

/// "`a`", or "one of `a`, `b`".
fn one_of(names: &[String]) -> String {
    let quoted: Vec<_> = names.iter().map(|name| format!("`{name}`")).collect();
    match quoted.len() {
        1 => quoted.concat(),
        _ => format!("one of {}", quoted.join(", ")),
    }
}

impl Wait {
    #[doc(hidden)]
    pub fn new(process: &str, operation: Operation, at: String, partner: Partner) -> Self {
        Self {
            process: process.to_owned(),
            operation,
            at,
            partner,
        }
    }

    /// What the process does, without its name.
    fn doing(&self) -> String {
        let at = &self.at;
        match self.operation {
            Operation::Send => format!("waits to send to {at}"),
            Operation::Receive => format!("waits to receive from {at}"),
            Operation::Sync => format!("waits at {at}"),
            Operation::Lock => format!("waits to lock {at}"),
            Operation::Notified => format!("waits to be notified at {at}"),
            Operation::Acquire => format!("waits for permits of {at}"),
            Operation::Join => format!("waits for the end of `{at}`"),
            Operation::Stop => {
                "has stopped: its alternative has no open guard and no `skip`".to_owned()
            }
        }
    }

    /// Whether the process of that name could end the wait, as far as is known.
    fn is_for(&self, name: &str) -> bool {
        match &self.partner {
            Partner::Process(partner) => partner == name,
            Partner::Holders(holders) => holders.iter().any(|holder| holder == name),
            _ => false,
        }
    }
}

impl Deadlock {
    #[doc(hidden)]
    pub fn new(system: &str, waits: Vec<Wait>, cycle: Vec<String>) -> Self {
        Self {
            system: system.to_owned(),
            waits,
            cycle,
        }
    }

    /// The processes of the circle, each with the wait that is for the next one.
    fn circle(&self) -> Vec<(&str, Option<&Wait>)> {
        let next = self.cycle.iter().cycle().skip(1);
        let both = self.cycle.iter().zip(next);
        both.map(|(name, next)| {
            let mut waits = self.waits.iter();
            let wait = waits.find(|wait| wait.process == *name && wait.is_for(next));
            (name.as_str(), wait)
        })
        .collect()
    }
}

impl fmt::Display for Wait {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Wait {
            process, operation, ..
        } = self;
        write!(f, "`{process}` {}", self.doing())?;
        if matches!(operation, Operation::Join | Operation::Stop) {
            return Ok(());
        }
        // The act by which a process becomes the partner.
        let (did, nobody) = match operation {
            Operation::Lock => ("holds it", "which nobody holds"),
            Operation::Notified => ("notified there last", "where nobody has notified yet"),
            Operation::Acquire => ("acquired there last", "where nobody has acquired any yet"),
            _ => (
                "used its other end last",
                "whose other end nobody has used yet",
            ),
        };
        match &self.partner {
            Partner::Process(name) if name == process && *operation == Operation::Lock => {
                f.write_str(", which it holds itself")
            }
            Partner::Process(name) if name == process => match operation {
                Operation::Notified | Operation::Acquire => write!(f, ", and {did} itself"),
                _ => f.write_str(", whose other end it used last itself"),
            },
            Partner::Process(name) => write!(f, " for `{name}`, which {did}"),
            Partner::Ended(name) => {
                write!(f, " for `{name}`, which {did} and has ended")?;
                match operation {
                    // The channel is not closed, so a handle of that end is left.
                    Operation::Send | Operation::Receive => {
                        f.write_str("; a clone of that end still lives: drop it")
                    }
                    _ => Ok(()),
                }
            }
            Partner::Nobody => write!(f, ", {nobody}"),
            Partner::Holders(names) => {
                write!(f, ", {nobody}; {} appears to hold it", one_of(names))
            }
            Partner::Others => f.write_str(" for parties that have not come"),
        }
    }
}

impl fmt::Display for Deadlock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "system `{}` is deadlocked: every process waits, and nothing that the system knows of can wake one",
            self.system
        )?;
        for wait in &self.waits {
            write!(f, "\n  {wait}")?;
        }
        let circle = self.circle();
        for (number, (name, wait)) in circle.iter().enumerate() {
            let begin = match number {
                0 => "\n  a circle: ",
                _ => " for ",
            };
            let which = if number == 0 { "" } else { ", which" };
            let doing = wait.map_or_else(|| "waits".to_owned(), Wait::doing);
            write!(f, "{begin}`{name}`{which} {doing}")?;
        }
        if let Some((first, _)) = circle.first() {
            write!(f, " for `{first}`")?;
        }
        let all = |operation| {
            let mut waits = circle.iter().map(|(_, wait)| *wait);
            circle.len() > 1
                && waits.all(|wait| wait.is_some_and(|wait| wait.operation == operation))
        };
        if all(Operation::Send) {
            f.write_str("\n  each of them sends first: let one receive first, or give one of the channels a buffer")?;
        } else if all(Operation::Receive) {
            f.write_str("\n  each of them receives first: let one send first")?;
        }
        if self.waits.iter().any(|wait| {
            matches!(wait.partner, Partner::Nobody | Partner::Others)
                && wait.operation != Operation::Stop
        }) {
            f.write_str(
                "\n  if a thread outside of the system is to use one of these, mark it with `external()`",
            )?;
        }
        Ok(())
    }
}
