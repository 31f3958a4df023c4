//! Which tasks delay a task.

use super::{Demand, Task, Thread};

/// A figure that a bound needs and that is not known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Gap {
    /// When this task is released, or how long it runs.
    #[error("when task {0} is released, or how long it runs, is not known")]
    Demand(usize),
    /// How long a poll of this task takes.
    #[error("how long a poll of task {0} takes is not known")]
    Poll(usize),
}

/// What delays the jobs of a task, apart from its own. Places in the set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Around {
    /// Of the tasks of lower priority on its thread, the one with the longest poll.
    pub(super) blocking: Option<usize>,
    /// Tasks of its thread that are as urgent: they delay it until its last poll begins.
    pub(super) beside: Vec<usize>,
    /// Those that delay it until its end.
    pub(super) above: Vec<usize>,
}

pub(super) fn around(threads: &[Thread], tasks: &[Task], number: usize) -> Result<Around, Gap> {
    let (task, own) = (&tasks[number], tasks[number].thread);
    let thread = &threads[own];
    let is_here = |other: usize| threads[other].core == thread.core;
    let is_peer =
        |other: usize| other != own && is_here(other) && threads[other].rank == thread.rank;
    // A thread of the same rank waits for all that is ready on this one, and this one for all that
    // came there meanwhile: then each task of both delays each.
    let has_peers = tasks.iter().any(|other| is_peer(other.thread));
    let mut found = Around {
        blocking: None,
        beside: Vec::new(),
        above: Vec::new(),
    };
    for (other, its) in tasks
        .iter()
        .enumerate()
        .filter(|(other, _)| *other != number)
    {
        let is_above = match its.thread == own {
            true => has_peers,
            false => is_here(its.thread) && threads[its.thread].rank >= thread.rank,
        };
        if is_above {
            found.above.push(other);
        } else if its.thread == own && its.priority >= task.priority {
            found.beside.push(other);
        } else if its.thread == own {
            let poll = its.longest_poll.ok_or(Gap::Poll(other))?;
            let longest = found
                .blocking
                .and_then(|longest| tasks[longest].longest_poll);
            if longest.is_none_or(|longest| longest < poll) {
                found.blocking = Some(other);
            }
        }
    }
    Ok(found)
}

/// The demands of these tasks.
pub(super) fn demands<'t>(tasks: &'t [Task], of: &[usize]) -> Result<Vec<&'t Demand>, Gap> {
    of.iter()
        .map(|number| tasks[*number].demand.as_ref().ok_or(Gap::Demand(*number)))
        .collect()
}
