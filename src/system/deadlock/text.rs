//! The text of a deadlock.

use super::{Deadlock, Operation, Partner, Wait};
use crate::csp::composition::kind_name;
use luna_channels::inspect::WaitPointView;
use std::fmt;

/// A wait point, as an operation of a report names it.
pub(super) fn place(wait_point: &WaitPointView) -> String {
    let kind = kind_name(wait_point.kind);
    match &wait_point.name {
        Some(name) => format!("{kind} `{name}`"),
        None => format!("the {kind} made at {}", wait_point.made_at),
    }
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
